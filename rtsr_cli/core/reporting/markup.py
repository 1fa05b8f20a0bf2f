"""HTML and JSON that hold foreign text safely."""

from __future__ import annotations

import html
import json
import math

from rtsr_cli.core.visible_text import make_all_visible, make_visible


def escape_text(value: object) -> str:
    """Escape a value for element content and for quoted attributes; what nobody sees is named."""
    return html.escape(make_visible(str(value)), quote=True)


def make_element(name: str, *children: str, **attributes: object) -> str:
    """Return an element.

    Args:
        name: of the element.
        children: markup, joined; foreign text goes through `escape_text` first.
        attributes: escaped here; `class_` is class, `data_x` is data-x, None leaves one out.
    """
    written = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escape_text(value)}"'
        for key, value in attributes.items()
        if value is not None
    )
    return f"<{name}{written}>{''.join(children)}</{name}>"


ESCAPES = {ord(c): f"\\u{ord(c):04x}" for c in "<>&\u2028\u2029"}
"""Characters that could end a script element or a line of one."""


def write_script_json(value: object) -> str:
    """Return JSON that may stand inside a script element.

    Raises:
        ValueError: a number is not finite; `to_plain_number` writes those.
    """
    plain = make_all_visible(value)
    dense = json.dumps(plain, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return dense.translate(ESCAPES)


def to_plain_number(value: float | None) -> float | str | None:
    """A number for JSON: six digits, infinities as the strings that JavaScript's Number reads."""
    if value is None or math.isnan(value):
        return None
    if math.isinf(value):
        return "Infinity" if value > 0 else "-Infinity"
    return float(f"{value:.6g}")
