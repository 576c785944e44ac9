# SPDX-License-Identifier: Apache-2.0
"""``docs/report-format.md``, made from the schema: ``python -m hil.report.format_page [--check]``.

The page holds nothing of its own but a few words around the tables, so that it cannot drift from
``report.schema.json``.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

from hil.atomic import write_whole
from hil.report.document import EXIT_CODES

PAGE: Final = Path(__file__).resolve().parents[2] / "docs" / "report-format.md"

_INTRODUCTION: Final = """# The report format

<!-- Made from hil/report/report.schema.json by `python -m hil.report.format_page`. -->

`report.json` is the only truth of a report: the page, the JUnit file, the badge, the job summary
and the terminal view are computed from it and from nothing else. Its form is fixed by the JSON
Schema (draft 2020-12) [`hil/report/report.schema.json`](../hil/report/report.schema.json), `$id`
`{schema_id}`, which is installed with `hil`:

```
python -c "from importlib.resources import files; print(files('hil.report') / 'report.schema.json')"
```

A document names its schema in `$schema` and its version in `schema_version`. Within version 1
properties are added, never removed or changed. Text that came from a recording is text: escape it
wherever it is shown.

Files beside it: `index.html` (one page, no network), `junit.xml`, and `badge.json` in the form of
a [shields.io endpoint](https://shields.io/badges/endpoint-badge).

## Exit codes

The command that judged, `hil report`, `hil replay` or `hil record`, ends with the code of the
gravest outcome. To `hil report` a run made to fail that fails in every check named for it is a
pass. Where a product failure and a rig failure meet, 1 wins. pytest ends with the same codes, and
with 11 only when `--require-live` was given. `hil report --compare` ends with 1 when a check of the
second run is worse than the first's and does not pass.

| outcome | exit code |
|---|---|
{exit_codes}

Wrong use and files that cannot be read end with 2.
"""


def render(schema: Mapping[str, Any]) -> str:
    """The whole page.

    Raises:
        KeyError: a property has no description.
    """
    codes = "\n".join(f"| `{outcome}` | {code} |" for outcome, code in EXIT_CODES.items())
    parts = [_INTRODUCTION.format(schema_id=schema["$id"], exit_codes=codes)]
    tables = {"The document": schema}
    tables |= {
        f"`{name}`": part for name, part in schema["$defs"].items() if part.get("properties")
    }
    for title, part in tables.items():
        parts.append(f"## {title}\n\n| property | type | meaning |\n|---|---|---|")
        parts.append("\n".join(f"| `{p}` | {t} | {d} |" for p, t, d in rows(part)) + "\n")
    parts.append("## Types\n\n| type | form | meaning |\n|---|---|---|")
    simple = {n: part for n, part in schema["$defs"].items() if not part.get("properties")}
    parts.append(
        "\n".join(f"| `{n}` | {_type(p)} | {p['description']} |" for n, p in simple.items()) + "\n"
    )
    return "\n".join(parts)


def rows(part: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str, str]]:
    """(dotted path, type, meaning) of each property of an object, nested ones after it."""
    for name, value in part.get("properties", {}).items():
        path = f"{prefix}{name}"
        yield path, _type(value), value["description"]
        yield from rows(value, f"{path}.")
        for key, sign in (("items", "[]."), ("additionalProperties", ".<key>.")):
            if isinstance(value.get(key), Mapping):
                yield from rows(value[key], path + sign)


def _type(value: Mapping[str, Any]) -> str:
    if "$ref" in value:
        return f"`{value['$ref'].rpartition('/')[2]}`"
    if "oneOf" in value:
        return " or ".join(_type(v) for v in value["oneOf"])
    if "const" in value:
        return f"`{value['const']}`"
    if "enum" in value:
        return ", ".join(f"`{v}`" for v in value["enum"])
    types = value["type"] if isinstance(value["type"], list) else [value["type"]]
    named = [f"array of {_type(value['items'])}" if t == "array" else t for t in types]
    return " or ".join(named)


def main(arguments: list[str]) -> int:
    """Write the page, or with ``--check`` exit 1 when it is not what the schema says."""
    schema = json.loads((files("hil.report") / "report.schema.json").read_text(encoding="utf-8"))
    page = render(schema)
    if "--check" in arguments:
        same = PAGE.is_file() and PAGE.read_text(encoding="utf-8") == page
        if not same:
            print(f"{PAGE} is not what the schema says: python -m hil.report.format_page")
        return 0 if same else 1
    write_whole(PAGE, page.encode("utf-8"))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
