"""The report of an evaluation: one HTML file that needs nothing else.

Style and script are inlined, pictures are data URIs, and a content security policy forbids
everything from outside. Tables and sentences are written here and need no script; curves and
the viewer are drawn by the scripts from the JSON that `payload` makes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import resources
from string import Template
from typing import Any

from rtsr_cli.core.reporting import tables
from rtsr_cli.core.reporting.markup import element, joined, script_json, text
from rtsr_cli.core.reporting.payload import payload
from rtsr_cli.core.reporting.pictures import Crop, Moment, Picture, Strip
from rtsr_cli.core.reporting.results import Results, read_results

SCRIPTS = ("shared.js", "curves.js", "viewer.js", "report.js")
"""Parts of the script, in the order in which they are joined."""

OVER_SHOTS = "; its values over all shots are means over the shots"

__all__ = ["Crop", "Moment", "Picture", "Strip", "html_report"]


def html_report(
    result: Mapping[str, Any], moments: Sequence[Moment] = (), strips: Sequence[Strip] = ()
) -> str:
    """Write the report of an evaluation.

    Args:
        result: what the evaluation returns and the JSON file holds.
        moments: frames to look at, the worst first; names of methods as in `result`.
        strips: rows of pixels over time.

    Returns:
        A page in UTF-8.
    """
    results = read_results(result)
    filled = {
        **_head(result, results),
        **_sections(result, results),
        "no_moments": "" if moments else "hidden",
        "some_moments": "hidden" if moments else "",
        "no_strips": "" if strips else "hidden",
        "css": _part("report.css"),
        "js": "\n".join(map(_part, SCRIPTS)),
        "data": script_json(payload(results, moments, strips)),
    }
    return Template(_part("report.html")).substitute(filled)


def _part(name: str) -> str:
    return resources.files(__package__).joinpath(name).read_text(encoding="utf-8")


def _head(result: Mapping[str, Any], results: Results) -> dict[str, str]:
    names = joined(results.methods)
    against = result.get("inputs", {}).get("reference")
    frames = sum(len(results.frames(shot)) for shot in results.shots)
    amount = f"{frames} frames"
    if len(results.shots) > 1:
        amount += f" of {len(results.shots)} shots"
    return {
        "title": text(f"{names}: rtsr report"),
        "names": text(names),
        "against": f" against {element('code', text(against))}" if against else "",
        "amount": amount,
        "protocol": text(result.get("protocol", "")),
        "description": text(result.get("description", "")),
        "version": text(result.get("version", "")),
        "rules": text(_sentence(result.get("rules", ""))),
    }


def _sentence(rules: str) -> str:
    return rules[:1].upper() + rules[1:]


def _sections(result: Mapping[str, Any], results: Results) -> dict[str, str]:
    shots = tables.by_shot(results)
    regions = tables.by_region(results)
    return {
        "summary": tables.summary(results),
        "sentences": tables.sentences(results),
        "shots": shots,
        "no_shots": "" if shots else "hidden",
        "regions": regions,
        "region_terms": tables.region_terms(results),
        "over_shots": OVER_SHOTS if shots else "",
        "no_regions": "" if regions else "hidden",
        "conventions": tables.conventions(results),
        "notes": tables.notes(results),
        "options": tables.facts(result.get("options", {})),
        "inputs": tables.facts(result.get("inputs", {})),
        "versions": tables.facts(result.get("versions", {})),
    }
