# SPDX-License-Identifier: Apache-2.0
"""A comparison as one self-contained page, under the same rules as the report's."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import DictLoader, Environment, StrictUndefined
from markupsafe import Markup

from hil.atomic import write_whole
from hil.errors import HilError
from hil.report import text as texts
from hil.report import words
from hil.report.compare import KINDS, Comparison


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
    styles = _asset("report.css") + _asset("compare.css")
    early, late = _asset("theme.js"), _asset("compare.js")
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
        policy=_policy(styles, (early, late)),
    )
    return page


def _policy(styles: str, scripts: Sequence[str]) -> str:
    """Content security policy that admits the page's own style and scripts, and nothing else."""

    def digest(text: str) -> str:
        return "'sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() + "'"

    return (
        f"default-src 'none'; style-src {digest(styles)}; "
        f"script-src {' '.join(digest(s) for s in scripts)}; base-uri 'none'; form-action 'none'"
    )


@cache
def _asset(name: str) -> str:
    return files("hil.report").joinpath("assets", name).read_text(encoding="utf-8")


@cache
def _template() -> Any:
    environment = Environment(
        loader=DictLoader({"compare.html": _asset("compare.html")}),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("compare.html")
