# SPDX-License-Identifier: Apache-2.0
"""A report's entries as rows of the history: who is who, and what repeats what."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

Entry = Mapping[str, Any]


def run(document: Entry, entry: Entry) -> dict[str, str]:
    """The row of ``run`` for one entry of ``document``."""
    provenance = entry["provenance"] or {}
    file = entry["file"] or {"sha256": ""}
    created = str(provenance.get("created_utc", document["generated_utc"]))
    return {
        "identity": identity(document, entry),
        "name": entry["name"],
        "source": entry["source"],
        "scenario": str(provenance.get("scenario", {}).get("name") or entry["name"]),
        "created_utc": utc(created),
        "build": " ".join(sorted({_build(i) for i in provenance.get("images", {}).values()})),
        "recording_sha256": file["sha256"],
        "repeats": repeats(entry),
    }


def identity(document: Entry, entry: Entry) -> str:
    """Equal for the same run, however often it is judged.

    The SHA-256 of the recording and when it was made; for a run without a file all that is known
    of where it came from; for one that never ran, which report says so.
    """
    if entry["file"]:
        return _hash("recording", entry["file"]["sha256"], entry["provenance"]["created_utc"])
    if entry["provenance"]:
        return _hash("provenance", entry["provenance"], entry["contents"])
    return _hash("none", document["generated_utc"], entry["id"], entry["outcome_reason"])


def repeats(entry: Entry) -> str:
    """Equal for runs of the same images and scenario on the same source; empty when unknown."""
    provenance = entry["provenance"]
    if not provenance or not provenance["images"]:
        return ""
    images = {
        role: sorted(str(f.get("sha256")) for f in (image.get("files") or {}).values())
        or str(image.get("build_id"))
        for role, image in provenance["images"].items()
    }
    return _hash(entry["source"], images, provenance["scenario"])


def judgement(document: Entry, entry: Entry) -> dict[str, str]:
    """The row of ``judgement``, but for its run."""
    said = [
        {key: value for key, value in m.items() if key not in ("how", "details")}
        for m in entry["measurements"]
    ]
    return {
        "content": _hash(entry["outcome"], entry["verdict"], said),
        "judged_utc": utc(document["generated_utc"]),
        "judged": entry["judged"],
        "rig_version": document["tool"]["version"],
        "rig_commit": document["rig"]["git"]["commit"],
        "rig_state": document["rig"]["git"]["state"],
        "verdict": entry["verdict"],
        "outcome": entry["outcome"],
        "reason": entry["outcome_reason"],
    }


def measurement(m: Entry) -> dict[str, Any]:
    """The row of ``measurement``, but for its judgement; NULL where a number is none."""
    return {
        **{key: m[key] for key in ("id", "name", "unit", "verdict", "budget", "how")},
        **{key: _number(m[key]) for key in ("value", "uncertainty")},
        **{key: _number(m["limits"][key]) for key in ("low", "high", "marginal")},
        "expected_fail": int(m["expected_fail"]),
    }


def utc(when: str) -> str:
    """An ISO 8601 time in UTC, so that text order is time order; what is none stays as it is."""
    try:
        parsed = datetime.fromisoformat(when)
        zoned = parsed if parsed.tzinfo else parsed.replace(tzinfo=UTC)
        return zoned.astimezone(UTC).isoformat(timespec="milliseconds")
    except (ValueError, OverflowError):
        return when


def _build(image: Entry) -> str:
    return str(image.get("build_id", "?"))


def _number(value: float | str | None) -> float | None:
    if value is None:
        return None
    number = float(value)
    return None if math.isnan(number) else number


def _hash(*parts: Any) -> str:
    text = json.dumps(parts, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()
