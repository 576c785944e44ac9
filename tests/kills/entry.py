# SPDX-License-Identifier: Apache-2.0
"""The ``hil`` command on another checkout or with images built before: ``TREE IMAGES ARGS...``.

``-`` leaves either as it is.
"""

import sys
from pathlib import Path

if __name__ == "__main__":
    tree, images, *arguments = sys.argv[1:]
    sys.argv = ["hil", *arguments]
    if tree != "-":
        from hil.build import sources

        sources.project_root = lambda: Path(tree)
    if images != "-":
        from hil import build
        from hil.bench import prepared

        build.build_images = lambda *_: prepared.images(Path(images))
    from hil.cli import main

    main()
