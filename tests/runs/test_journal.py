"""Events survive as JSON lines, the table accounts for all the time."""

from command_line import read_events
from gsedit_cli.core.progress import stage_table

from gsedit import Event
from gsedit.run.events import as_record
from gsedit.run.json_lines import Journal

EVENTS = [
    Event("render", 1.0, note="8 views"),
    Event("update", 2.0, step=10, steps=20, loss=0.5),
    Event("update", 4.5, step=20, steps=20, loss=0.25, error=0.1),
    Event("measure", 5.0, error=0.01),
    Event("update", 7.0, step=5, steps=20, loss=0.2),
]


def test_what_is_written_is_read_back(tmp_path):
    journal = Journal(tmp_path / "metrics.jsonl", as_record)
    for event in EVENTS:
        journal.write(event)
    assert journal.records == EVENTS
    assert read_events(journal.path) == EVENTS


def test_table_has_a_row_a_stage_and_straight_columns():
    lines = stage_table(EVENTS).splitlines()
    assert len(lines) == 1 + 3
    assert len({len(line) for line in lines}) == 1
    assert "20.0" in lines[2]  # 0.1 RMSE is 20 dB
    assert stage_table([]).startswith("stage")
