"""``python -m benchmarks`` and ``python benchmarks``."""

import sys
from pathlib import Path

# `python benchmarks` puts this directory on the path, not the one that holds the package.
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.run import main

sys.exit(main())
