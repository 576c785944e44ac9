# SPDX-License-Identifier: Apache-2.0
"""What git says of a folder: at which commit it is, and whether it was changed since."""

from __future__ import annotations

from pathlib import Path

from hil.process.run import capture


def state(folder: Path, *paths: str, tracked: str = "") -> tuple[str, str]:
    """Commit of the checkout that ``folder`` lies in, and clean, dirty or unknown.

    The commit is empty where there is none; unknown is what lies in no checkout.

    Args:
        paths: below ``folder``: where a change counts.
        tracked: a file that the checkout must know, or it is somebody else's.
    """
    git = ("git", "-C", folder)
    ours = ("ls-files", "--", tracked) if tracked else ("rev-parse", "--is-inside-work-tree")
    # Within .git itself git says "false".
    if capture([*git, *ours]) in ("", "false"):
        return "", "unknown"
    commit = capture([*git, "rev-parse", "--verify", "--quiet", "HEAD"])
    changed = capture([*git, "status", "--porcelain", "--", *paths])
    return commit, "dirty" if changed or not commit else "clean"
