"""Tables of docs/measurements/objects.md from what `gsedit bench objects` measured.

python -m research.objects_page out/objects/objects.jsonl
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from bench.objects.rows import Row, table

from gsedit.bench.provenance import Provenance


def main(path: Path) -> None:
    """Print the tables of a file, and where they come from."""
    records = [json.loads(line) for line in path.read_text().splitlines()]
    rows = [Row(**{**each, "provenance": Provenance(**each["provenance"])}) for each in records]
    origin = rows[0].provenance
    sys.stdout.write(f"{table(rows)}\n\n`gsedit bench objects`, commit {origin.commit}, ")
    sys.stdout.write(f"{origin.date[:10]}, {origin.machine}, {origin.threads} thread(s).\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
