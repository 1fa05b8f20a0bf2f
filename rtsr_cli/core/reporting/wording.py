"""What the numbers say, a sentence a metric."""

from __future__ import annotations

import math

from rtsr_cli.core.reporting.markup import joined
from rtsr_cli.core.reporting.results import Metric, Results, Values
from rtsr_cli.core.statistics import interval

MOST_REGIONS = 3
"""Regions named in a sentence."""

WHOLE = "all"
"""The region that is the whole frame: it decides nothing of its own."""


def lead(metric: Metric, values: Values) -> tuple[str, str, float] | None:
    """The best, the next and their distance; None for a tie, or where nothing is to be compared."""
    if len(metric.best(values)) != 1:
        return None
    (first, top), (second, next_) = metric.ranked(values)[:2]
    gap = abs(top - next_)
    return (first, second, gap) if math.isfinite(gap) else None


def sentence(results: Results, metric: Metric) -> str:
    """Who is best in a metric, by how much, how surely, how often, and where not."""
    values = results.means(metric)
    best = [name for name in results.methods if name in metric.best(values)]
    if not best:
        return _without_a_best(metric, values)
    top = metric.measure(values[best[0]])
    if len(best) > 1:
        return f"{joined(best)} tie at {top}."
    parts = [f"{best[0]} is best: {top}", _frames(results, metric, best[0])]
    found = lead(metric, values)
    if found:
        relation = "over" if metric.sign > 0 else "below"
        parts.insert(1, f"{metric.measure(found[2])} {relation} {found[1]}")
        parts[1] += _certainty(results, metric, found[0], found[1])
    losses = _losses(results, metric, best[0])
    return ", ".join(filter(None, parts)) + (f"; {losses}." if losses else ".")


def _without_a_best(metric: Metric, values: Values) -> str:
    known = [f"{name} {metric.measure(v)}" for name, v in values.items() if v is not None]
    return f"{joined(known)}." if known else "Nothing could be measured."


def _certainty(results: Results, metric: Metric, first: str, second: str) -> str:
    """The interval of the lead, frame by frame: the two tests' own scatter does not matter."""
    rounds = [(values.get(first), values.get(second)) for values in results.rounds(metric)]
    leads = [metric.sign * (a - b) for a, b in rounds if a is not None and b is not None]
    found = interval([lead for lead in leads if math.isfinite(lead)])
    if found is None:
        return ""
    low, high = metric.text(found[0]), metric.measure(found[1])
    doubt = "" if found[0] > 0.0 else ", which holds 0"
    return f" (95 % interval {low} to {high}{doubt})"


def _frames(results: Results, metric: Metric, best: str) -> str:
    """In how many frames it alone is best, and in how many among the best."""
    decided = [names for values in results.rounds(metric) if (names := metric.best(values))]
    if not decided:
        return ""
    alone = sum(list(names) == [best] for names in decided)
    level = sum(best in names for names in decided) - alone
    also = f", level in {level}" if level else ""
    return f"ahead in {alone} of {len(decided)} frames{also}"


def _losses(results: Results, metric: Metric, best: str) -> str:
    lost = []
    for region, (title, _) in results.regions.items():
        values = results.in_region(metric, region)
        winners = metric.best(values)
        if region != WHOLE and winners and best not in winners and values.get(best) is not None:
            lost.append(f"in {title} (to {joined(sorted(winners))})")
    named = joined(lost[:MOST_REGIONS])
    more = len(lost) - MOST_REGIONS
    return (f"it loses {named}" + (f" and in {more} more regions" if more > 0 else "")) * bool(lost)
