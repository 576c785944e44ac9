# SPDX-License-Identifier: Apache-2.0
"""What every HTML page of a report is made with: its assets, its template, its security policy."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib.resources import files
from typing import Any

from jinja2 import DictLoader, Environment, StrictUndefined


def policy(styles: str, scripts: Sequence[str]) -> str:
    """Content security policy that admits the page's own style and scripts, and nothing else."""

    def digest(text: str) -> str:
        return "'sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() + "'"

    return (
        f"default-src 'none'; style-src {digest(styles)}; "
        f"script-src {' '.join(digest(s) for s in scripts)}; base-uri 'none'; form-action 'none'"
    )


@cache
def asset(name: str) -> str:
    """Text of a file below ``assets``."""
    return files("hil.report").joinpath("assets", *name.split("/")).read_text(encoding="utf-8")


def template(name: str, filters: Mapping[str, Callable[..., Any]] | None = None) -> Any:
    """The template ``name`` of the assets, strict about what it is given."""
    environment = Environment(
        loader=DictLoader({name: asset(name)}),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(filters or {})
    return environment.get_template(name)
