"""What the numbers say, a sentence a metric."""

from __future__ import annotations

import math

from rtsr_cli.core.reporting.results import Results, ShownMetric, Values
from rtsr_cli.core.statistics import mean_interval
from rtsr_cli.core.wording import join_names

MOST_REGIONS = 3
"""Regions named in a sentence."""

WHOLE = "all"
"""The region that is the whole frame: it decides nothing of its own."""


def find_lead(metric: ShownMetric, values: Values) -> tuple[str, str, float] | None:
    """The best, the next and their distance; None for a tie, or where nothing is to be compared."""
    if len(metric.best(values)) != 1:
        return None
    (first, top), (second, next_) = metric.rank(values)[:2]
    gap = abs(top - next_)
    return (first, second, gap) if math.isfinite(gap) else None


def write_sentence(results: Results, metric: ShownMetric) -> str:
    """Who is best in a metric, by how much, how surely, how often, and where not."""
    values = results.means(metric)
    best = [name for name in results.methods if name in metric.best(values)]
    if not best:
        return _describe_tie(metric, values)
    top = metric.measure(values[best[0]])
    if len(best) > 1:
        return f"{join_names(best)} tie at {top}."
    parts = [f"{best[0]} is best: {top}", _describe_frames(results, metric, best[0])]
    leader = find_lead(metric, values)
    if leader:
        relation = "over" if metric.sign > 0 else "below"
        parts.insert(1, f"{metric.measure(leader[2])} {relation} {leader[1]}")
        parts[1] += _describe_certainty(results, metric, leader[0], leader[1])
    losses = _describe_losses(results, metric, best[0])
    return ", ".join(filter(None, parts)) + (f"; {losses}." if losses else ".")


def _describe_tie(metric: ShownMetric, values: Values) -> str:
    known = [f"{name} {metric.measure(v)}" for name, v in values.items() if v is not None]
    return f"{join_names(known)}." if known else "Nothing could be measured."


def _describe_certainty(results: Results, metric: ShownMetric, first: str, second: str) -> str:
    """The interval of the lead, frame by frame: the two tests' own scatter does not matter."""
    rounds = [(values.get(first), values.get(second)) for values in results.rounds(metric)]
    leads = [metric.sign * (a - b) for a, b in rounds if a is not None and b is not None]
    bounds = mean_interval([lead for lead in leads if math.isfinite(lead)])
    if bounds is None:
        return ""
    low, high = metric.text(bounds[0]), metric.measure(bounds[1])
    doubt = "" if bounds[0] > 0.0 else ", which holds 0"
    return f" (95 % interval {low} to {high}{doubt})"


def _describe_frames(results: Results, metric: ShownMetric, best: str) -> str:
    """In how many frames it alone is best, and in how many among the best."""
    decided = [names for values in results.rounds(metric) if (names := metric.best(values))]
    if not decided:
        return ""
    alone = sum(list(names) == [best] for names in decided)
    level = sum(best in names for names in decided) - alone
    also = f", level in {level}" if level else ""
    return f"ahead in {alone} of {len(decided)} frames{also}"


def _describe_losses(results: Results, metric: ShownMetric, best: str) -> str:
    lost = []
    for region, (title, _) in results.regions.items():
        values = results.in_region(metric, region)
        winners = metric.best(values)
        if region != WHOLE and winners and best not in winners and values.get(best) is not None:
            lost.append(f"in {title} (to {join_names(sorted(winners))})")
    named = join_names(lost[:MOST_REGIONS])
    more = len(lost) - MOST_REGIONS
    return (f"it loses {named}" + (f" and in {more} more regions" if more > 0 else "")) * bool(lost)
