# SPDX-License-Identifier: Apache-2.0
"""``docs/faults.md``, made from the tables: ``python -m hil.faults.page [--check]``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Final

from hil.atomic import write_whole
from hil.faults.injection import KINDS, Kind, parse_all
from hil.faults.table import FIXTURE, OTHERWISE, ROWS
from hil.synthesis import FAULTS
from hil.synthesis.caught_by import CAUGHT_BY

PAGE: Final = Path(__file__).resolve().parents[2] / "docs" / "faults.md"

_INTRODUCTION: Final = """# Faults made on purpose

<!-- Made from hil/faults and hil/synthesis by `python -m hil.faults.page`. -->

A check that cannot fail checks nothing. So faults can be put into a run, and each check is seen to
catch one: the tests run every row of the tables on this page.

## Injecting a fault

    hil record --inject drop:follower=1e-4@5..20 fixtures/scenarios/clean-7ms5.toml -o my-run
    hil replay --inject corrupt=1e-5 fixtures/recordings/clean-7ms5
    pytest tests/hil --recording fixtures/recordings/clean-7ms5 --inject drop=1e-4
    pytest tests/hil --board=sim --inject storm=10@5..15

`KIND[:STREAM][=VALUE][@FROM..TO][#SEED]`; `--inject` may be repeated, and faults are applied in
their order. STREAM is a role, or for edges also a pin such as `follower.pulse`; FROM and TO are
seconds of the run. The same faults with the same seed change the same bytes, whatever the source
and however its reads are cut; only `reorder` stays within a read. In a scenario:

    [[inject]]
    kind = "drop"
    stream = "follower"
    value = 1e-4
    from_s = 5.0
    to_s = 20.0

Faults of bytes, edges and clocks are put between the source and its recording: on the simulated
radio, on boards, and on a recording made earlier. `absent` leaves the follower out of a simulation;
elsewhere it takes out what it said and did. `reboot` takes the power from a node as its line shows
it: silence, then what the node says from its boot on, while its pins stay quiet; the firmware
itself is not started again. BabbleSim's radio admits its devices once, before time begins, so that
a simulated node cannot leave the air and come back, and a brown-out of running firmware is not
simulated. `storm` and `flash` are done to the nodes.

An injected run is never taken for a clean one: the faults are part of the recording's name, of its
scenario and of its events, which also count what was changed; every view of a report says them in
words; and a run whose faults no check noticed is inconclusive, with exit code 1. No default run
takes scenarios or recordings with faults.

"""


def render() -> str:
    """The page."""
    parts = [
        _INTRODUCTION,
        "| kind | what happens | value | default | done to |\n|---|---|---|---|---|\n",
    ]
    parts += [
        f"| `{name}` | {_meaning(kind)} | {_value(kind)} | "
        f"{f'{kind.default:g}' if kind.unit else '–'} | {_sources(kind)} |\n"
        for name, kind in KINDS.items()
    ]
    parts.append(
        "\n## What catches an injected fault\n\n"
        f"Put into the recording `{FIXTURE}`, which passes every check, by "
        "`tests/unit/faults/test_fault_table.py`; what is done to the firmware is run on the "
        "simulated radio by `tests/firmware/test_faults_live.py`.\n\n"
        "| fault | in words | must be caught by | on |\n|---|---|---|---|\n"
    )
    for row in ROWS:
        words = "; ".join(one.sentence() for one in parse_all(row.inject.split()))
        caught = ", ".join(f"`{name}`" for name in row.caught_by)
        where = "simulated radio" if row.live else "recording"
        parts.append(f"| `{row.inject}` | {words} | {caught} | {where} |\n")
    parts.append(
        "\n## What catches a fault of the nodes' behaviour\n\n"
        "Computed runs, each with one fault, in which exactly these checks must fail and all "
        "others pass: `tests/unit/test_checks.py`.\n\n"
        "| fault | in words | caught by |\n|---|---|---|\n"
    )
    for name, fault in FAULTS.items():
        caught = ", ".join(f"`{check}`" for check in sorted(CAUGHT_BY[name]))
        parts.append(f"| `{name}` | {fault.meaning} | {caught} |\n")
    parts.append(
        "\n## The other checks\n\nCaught failing by a test of their own.\n\n"
        "| check | test |\n|---|---|\n"
    )
    parts += [f"| `{_name(pattern)}` | `{test}` |\n" for pattern, test in OTHERWISE.items()]
    return "".join(parts)


def _meaning(kind: Kind) -> str:
    return " ".join(kind.meaning.format(value="VALUE", where="").split())


def _value(kind: Kind) -> str:
    return {"": "–", "s": "seconds", "share": "share, 0 to 1", "count": "number"}[kind.unit]


def _sources(kind: Kind) -> str:
    names = {"sim": "simulated radio", "bench": "boards", "replay": "recordings"}
    return ", ".join(names[source] for source in kind.sources)


def _name(pattern: str) -> str:
    """A pattern of names as a reader wants it."""
    return pattern.replace("\\.", ".").replace(".+", "*").replace("|", ", ")


def main(arguments: list[str]) -> int:
    """Write the page, or with ``--check`` exit 1 when it is not what the tables say."""
    page = render()
    if "--check" in arguments:
        same = PAGE.is_file() and PAGE.read_text(encoding="utf-8") == page
        if not same:
            print(f"{PAGE} is not what the tables say: python -m hil.faults.page")
        return 0 if same else 1
    write_whole(PAGE, page.encode("utf-8"))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
