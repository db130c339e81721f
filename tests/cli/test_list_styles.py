"""`gsedit list styles`: their names, and a sheet of them on a scene of the user's."""

import json

from command_line import files, gsedit
from PIL import Image

from gsedit.paper.editors.painter.editor import COLUMNS
from gsedit.paper.editors.painter.editor import SHEET_CELL as CELL
from gsedit.pictures.contact_sheet import CAPTION, MARGIN
from gsedit.words.lexicon import styles


def test_every_style_is_listed_with_what_asks_for_it():
    result = gsedit("list", "styles", "--json")
    listed = [json.loads(line) for line in result.stdout.splitlines()]
    assert [each["name"] for each in listed] == list(styles())
    assert all(each["words"] for each in listed)
    assert "starry night" in gsedit("list", "styles").stdout


def test_a_sheet_shows_a_scene_in_every_style(room, tmp_path):
    out = tmp_path / "styles.png"
    result = gsedit("list", "styles", room / "room.ply", "-o", out)
    assert result.exit_code == 0
    assert result.stdout.strip() == str(out)
    assert list(files(tmp_path)) == [out]
    cells = -(-(len(styles()) + 1) // COLUMNS)
    with Image.open(out) as sheet:
        assert sheet.size[0] == MARGIN + COLUMNS * (CELL + MARGIN)
        assert sheet.size[1] == MARGIN + cells * (CELL + CAPTION)
        colors = [
            sheet.getpixel((MARGIN + i * (CELL + MARGIN) + CELL // 2, CELL // 2)) for i in (0, 1)
        ]
    assert colors[0] != colors[1]
