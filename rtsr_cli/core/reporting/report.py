"""The report of an evaluation: one HTML file that needs nothing else.

Style and script are inlined, pictures are data URIs, and a content security policy forbids
everything from outside. Tables and sentences are written here and need no script; curves and
the viewer are drawn by the scripts from the JSON that `build_payload` makes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import resources
from string import Template
from typing import Any

from rtsr_cli import __version__
from rtsr_cli.core.marks import MARK
from rtsr_cli.core.reporting import tables
from rtsr_cli.core.reporting.markup import escape_text, make_element, write_script_json
from rtsr_cli.core.reporting.payload import build_payload
from rtsr_cli.core.reporting.pictures import Crop, Moment, Picture, Strip
from rtsr_cli.core.reporting.results import Results, read_results
from rtsr_cli.core.wording import join_names, say_count

SCRIPTS = ("shared.js", "curves.js", "viewer.js", "report.js")
"""Parts of the script, in the order in which they are joined."""

OVER_SHOTS = "; its values over all shots are means over the shots"

__all__ = ["Crop", "Moment", "Picture", "Strip", "write_html_report"]


def write_html_report(
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
        **_write_head(result, results),
        **_write_sections(result, results),
        "no_moments": "" if moments else "hidden",
        "some_moments": "hidden" if moments else "",
        "no_strips": "" if strips else "hidden",
        "css": _read_part("report.css"),
        "js": "\n".join(map(_read_part, SCRIPTS)),
        "data": write_script_json(build_payload(results, moments, strips)),
    }
    return Template(_read_part("report.html")).substitute(filled)


def _read_part(name: str) -> str:
    return resources.files(__package__).joinpath(name).read_text(encoding="utf-8")


def _write_head(result: Mapping[str, Any], results: Results) -> dict[str, str]:
    names = join_names(results.methods)
    against = result.get("inputs", {}).get("reference")
    frames = sum(len(results.frames(shot)) for shot in results.shots)
    amount = say_count(frames, "frame")
    if len(results.shots) > 1:
        amount += f" of {say_count(len(results.shots), 'shot')}"
    return {
        "mark": escape_text(MARK),
        "written_by": escape_text(__version__),
        "title": escape_text(f"{names}: rtsr report"),
        "names": escape_text(names),
        "against": f" against {make_element('code', escape_text(against))}" if against else "",
        "amount": amount,
        "protocol": escape_text(result.get("protocol", "")),
        "description": escape_text(result.get("description", "")),
        "version": escape_text(result.get("version", "")),
        "rules": escape_text(_describe_rules(result.get("rules", ""))),
    }


def _describe_rules(rules: str) -> str:
    return rules[:1].upper() + rules[1:]


def _write_sections(result: Mapping[str, Any], results: Results) -> dict[str, str]:
    shots = tables.write_shot_tables(results)
    regions = tables.write_region_tables(results)
    return {
        "summary": tables.write_summary(results),
        "sentences": tables.write_sentences(results),
        "shots": shots,
        "no_shots": "" if shots else "hidden",
        "regions": regions,
        "region_terms": tables.write_region_terms(results),
        "over_shots": OVER_SHOTS if shots else "",
        "no_regions": "" if regions else "hidden",
        "conventions": tables.write_conventions(results),
        "notes": tables.write_notes(results),
        "options": tables.write_facts(result.get("options", {})),
        "inputs": tables.write_facts(result.get("inputs", {})),
        "versions": tables.write_facts(result.get("versions", {})),
    }
