"""Write anew what a page shows of the program: `python tests/rewrite.py readme` (tutorial, notebooks, page).

The test file of that name holds the page and can write it: it is run as a program, with the modules that
the tests share on the path.
"""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

TESTS = Path(__file__).parent


def main(names: list[str]) -> None:
    sys.path[:0] = [str(TESTS), str(TESTS / "support")]
    for name in names:
        files = sorted(TESTS.rglob(f"test_{name}.py"))
        if not files:
            sys.exit(f"there is no test_{name}.py below {TESTS}")
        sys.argv = [str(files[0])]
        runpy.run_path(str(files[0]), run_name="__main__")


if __name__ == "__main__":
    main(sys.argv[1:] or ["readme", "tutorial", "notebooks", "page"])
