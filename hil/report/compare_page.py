# SPDX-License-Identifier: Apache-2.0
"""A comparison as one self-contained page, under the same rules as the report's."""

from __future__ import annotations

from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from markupsafe import Markup

from hil.atomic import write_whole
from hil.errors import HilError
from hil.report import text as texts
from hil.report import words
from hil.report.compare import KINDS, Comparison
from hil.report.page import asset, policy, template


def write(found: Comparison, directory: Path) -> Path:
    """Write ``compare.html`` into ``directory``, whole or not at all.

    Raises:
        HilError: the directory cannot be made or written to.
    """
    path = directory / "compare.html"
    try:
        write_whole(path, render(found).encode("utf-8"))
    except OSError as error:
        raise HilError(
            f"{path}: the comparison cannot be written: {error.strerror or error}",
            "name a folder that you may write to: hil report --compare A B -o DIR",
        ) from error
    return path


def render(found: Comparison) -> str:
    """The page for a comparison."""
    styles = asset("report.css") + asset("compare.css")
    early, late = asset("theme.js"), asset("compare.js")
    verdict, sentence = found.headline
    page: str = _template().render(
        found=found,
        verdict=verdict,
        headline=sentence,
        kinds=KINDS,
        version=version("hil"),
        made=[texts.moment(when) for when in found.made_utc],
        measured=lambda m: "–" if m["value"] is None else texts.quantity(m).measured,
        allowed=lambda m: texts.quantity(m).allowed,
        words=words,
        count=words.count,
        styles=Markup(styles),  # noqa: S704 (our own assets)
        early_script=Markup(early),  # noqa: S704
        late_script=Markup(late),  # noqa: S704
        policy=policy(styles, (early, late)),
    )
    return page


@cache
def _template() -> Any:
    return template("compare.html")
