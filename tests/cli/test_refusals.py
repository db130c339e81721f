"""A request that cannot be met ends in one line and an exit code, and nothing is written."""

from __future__ import annotations

import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
from bad_files import PLY_COLUMNS, dataset, ply_bytes, scene_table
from command_line import files, gsedit
from PIL import Image

from gsedit import load
from gsedit.select.saved import save_named

EDIT = "edit scene.ply 'as gold' --data photos"
ROOM = "edit room/room.ply --size 96"
CLICK = "--at view_0:20,50"
"""A pixel of the red ball, at 96 pixels."""
REFUSED = """
2 | nonsense | nonsense
2 | --nonsense | --nonsense
2 | info | SCENE
2 | info scene.ply other.ply | other.ply
2 | info --strict scene.ply | --check
2 | info ended | convert
3 | info none.ply | none.ply
2 | edit scene.ply 'as gold' --preview a.png | -o before the file
2 | fit photos | -o
2 | fit photos -o a.ply --steps many | --steps
2 | fit photos -o a.ply --quality best | draft
2 | fit photos -o taken.ply | -f
2 | fit photos -o a.ply --set stpes=3 | steps
2 | fit photos -o a.ply --set nothing-like-it=3 | list settings
2 | fit photos -o a.ply --set steps | NAME=VALUE
2 | fit photos -o scene.ply/a.ply | scene.ply
3 | fit none -o a.ply | none

2 | convert scene.ply | -o
2 | convert scene.ply --sh-degree 0 then | nothing follows
2 | convert scene.ply --sh-degree 0 then convrt | convrt
2 | convert scene.ply -o scene.obj | gsedit writes
2 | convert scene.ply --sh-degree 0 then convert --sh-degre 1 -o a.ply | --sh-degre
2 | convert scene.ply --sh-degree 0 -o taken.ply | -f
2 | convert scene.ply a.ply -o b.spz | two scenes
2 | convert scene.ply -o a.ply then convert --order morton -o b.ply | one -o
2 | convert scene.ply -o a.ply --order size | morton
3 | convert bad.ply -o a.ply | row 3
3 | convert bad.ply a.splat | row 3
3 | convert scene.ply none/a.ply --undo-dataparser exported/dataparser_transforms.json | dataparser
2 | merge scene.ply -o a.ply | OTHER
3 | merge scene.ply none.ply -o a.ply | none.ply
3 | merge scene.ply bad.ply -o a.ply | bad.ply
2 | merge scene.ply room/room.ply then filter --where seen(pixels=1) --dry-run | --data
2 | decimate scene.ply half -o a.ply | 50%
2 | decimate scene.ply 0 -o a.ply | at least 1

2 | transform scene.ply -o a.ply | name what to do
2 | transform scene.ply --translate 1,2 -o a.ply | --translate
2 | transform scene.ply --scale two -o a.ply | --scale
2 | transform scene.ply --scale 2 --scale 3 -o a.ply | --scale
2 | transform scene.ply --mirror w -o a.ply | x, y and z
2 | transform scene.ply --up z -o a.ply | z,-y
2 | transform scene.ply --pivot middle --scale 2 -o a.ply | --pivot
3 | transform scene.ply --matrix none.txt -o a.ply | none.txt
2 | transform scene.ply --scale 1e39 -o a.ply | became invalid
2 | transform scene.ply --scale 2 --cameras -o a.ply | cameras.json
2 | align scene.ply -o a.ply | --to-ground
2 | align scene.ply --to-ground --length 0,0,0,1,1,1=2 -o a.ply | --length
2 | align scene.ply --length 1,2=3 -o a.ply | --length
3 | align scene.ply --to none.ply -o a.ply | none.ply
2 | align scene.ply --to-ground --save a.txt -o a.ply | .json

2 | filter scene.ply -o a.ply | --where
2 | filter scene.ply --where 'box(1,2,3)' -o a.ply | box(
2 | filter scene.ply --where 'sphere(0,0,0,-1)' -o a.ply | radius
2 | filter scene.ply --where 'opacty > 0.1' -o a.ply | did you mean opacity
2 | filter scene.ply --where 'largest(10)' -o a.ply | largest(
2 | filter scene.ply --where "largest('x', opacity)" -o a.ply | amount
2 | filter scene.ply --where "near('brown')" -o a.ply | #rrggbb
2 | filter scene.ply --where 'opacity >= 2' -o a.ply | no Gaussians
2 | filter scene.ply --where 'middle(0.5)' -o a.ply | --data
2 | filter scene.ply --region spere:1 -o a.ply | spere
2 | filter room/room.ply --region chair -o a.ply | ball
3 | filter scene.ply --where "inside('missing.obj')" -o a.ply | missing.obj
3 | filter bad.ply --where 'x > -99' -o a.ply | row 3
2 | convert scene.ply --order morton then filter --where "flags('flags5.npy')" --dry-run | --order
2 | select scene.ply --where 'all()' -o flags7.npy | -f
2 | clean scene.ply --dry-run --where 'x <' | --where
2 | clean bad.ply --repair --mark -o a.ply | --repair
2 | clean bad.ply --repair --where 'x < 0' -o a.ply | --repair
2 | clean scene.ply --dry-run --reasons flags7.npy | -f
2 | recolor scene.ply -o a.ply | changes nothing
2 | recolor scene.ply --curve '0.5;0.6' -o a.ply | 0:0.1
2 | recolor scene.ply --temperature 10 -o a.ply | kelvin
3 | recolor scene.ply --palette none.png -o a.ply | none.png
2 | recolor scene.ply --exposure bright -o a.ply | --exposure

2 | select room/room.ply --dry-run --at view_0:20 | a column and a row
2 | select room/room.ply --dry-run --at viewer_0:2,3 | view_0
2 | select room/room.ply --size 96 --dry-run --at 0:200,3 | beside the picture
2 | select room/room.ply --size 96 --dry-run --at 0:1,1 | nothing is at
2 | select room/room.ply --dry-run CLICK --phrase it | leave one out
2 | select room/room.ply CLICK --as a/b | no name
2 | select room/room.ply CLICK --as it | no name
2 | select room/room.ply --size 96 CLICK --as ball | --force
2 | select room/room.ply --size 96 --dry-run --phrase 'the purple one' | --objects
2 | select room/room.ply --size 96 --dry-run --phrase everything | whole scene
2 | select room/room.ply --size 96 --dry-run --phrase 'the ears' | network
2 | select room/room.ply --as ball | add one
2 | select room/room.ply --objects --where 'x > 0' | alone
2 | select room/room.ply --masks command -o x.npy | --phrase
2 | select room/room.ply --masks-run 'x {input} {output}' --phrase a -o x.npy | --masks
2 | select room/room.ply --masks command --phrase a -o x.npy | --masks-run
2 | select room/room.ply --masks sam9 --phrase a -o x.npy | clipseg
2 | select room/room.ply --masks clipseg --masks-run x --phrase a -o x.npy | --masks-run

2 | edit scene.ply '' -o out | empty
2 | edit scene.ply remove the bear | quotes
2 | edit scene.ply 'give it a hat' -o out | the file of a scene
2 | edit scene.ply 'not red' -o out | must not be
2 | edit scene.ply 'blorp the zizzle' --editor closed-form -o out | zizzle
2 | EDIT -o taken | -f
2 | EDIT -o taken --resume | taken
2 | EDIT -o link | link
2 | EDIT -o . -f | name another
2 | EDIT -o photos/.. -f | name another
2 | edit edit 'as gold' -o edit -f | name another
2 | EDIT -o out --seed -1 | --seed
2 | EDIT -o out --geometry none | --geometry
2 | EDIT -o out --set sampler.stps=3 | sampler.steps
2 | EDIT -o out --set sampler.consensus=perhaps | on or off
2 | EDIT -o out --strategy throwaway | single-pass
2 | EDIT -o out --region there | region
2 | EDIT -o out --region hat5 | hat
3 | EDIT -o out --region hat | another order
3 | edit scene.ply 'remove the hat' --data photos -o out | another order
2 | EDIT -o out --editor closed-form --features gone.pth | filters or vgg
2 | edit scene.ply 'paint it red' --steps 3 -o out | nothing that is drawn
2 | edit scene.ply 'as a woodcut' --brush 0.3 -o out | brush is 0.3: give a number from 0.4 to 10
2 | edit scene.ply 'as a hologram' -o out | graffiti and nocturne
2 | edit scene.ply 'in the style of Giacometti' -o out | the nearest are
2 | edit scene.ply 'in the style of this picture' -o out | --like
2 | edit scene.ply 'paint it red' --editor painter -o out | nothing that is drawn
2 | edit scene.ply 'make it impressionist' --condition photo -o out | --data
3 | edit scene.ply 'insert there/is/none.ply' --data photos -o out | none.ply
3 | edit none.ply 'put nowhere.ply on the ground' -o out | nowhere.ply
2 | edit scene.ply 'remove it' --data photos --region all -o out | whole scene
2 | EDIT --preview -o out | .png
2 | EDIT --preview -o taken.png | exists
2 | ROOM 'paint it teal' CLICK --region all -o out | leave one out
2 | ROOM 'paint it teal' --at view_0:20 -o out | a column and a row
2 | ROOM 'paint it teal' --at 0:1,1 -o out | nothing is at
2 | ROOM 'make it impressionist' --masks command --masks-run true -o out | remove the chair
2 | ROOM 'as gold' --editor closed-form --masks clipseg -o out | 2D editor
2 | list looks ' ' | empty
2 | list settings nothing | nothing
2 | list styles scene.ply | -o styles.png
2 | list styles -o a.png | SCENE
2 | list looks -o a.png | list styles SCENE
2 | list styles scene.ply -o a.jpg | .png
2 | list styles scene.ply -o taken.png | exists
3 | list styles none.ply -o a.png | none.ply

2 | make photos 'give it a hat' -o out | the file of a scene
3 | make none 'as gold' -o out | none
2 | make photos 'as gold' -o taken | taken
2 | make photos 'as gold' -o photos -f | photos
2 | make photos 'as gold' -o out --focal 26 | --focal
2 | make pictures 'as gold' -o out --frames 9 | photos

2 | render scene.ply -o taken | -f
2 | render scene.ply -o scene.ply/a | scene.ply
2 | render scene.ply -o out --views 0,8 | cameras.json
2 | render scene.ply -o out --data photos --views 0,eight | eight
2 | render scene.ply -o out --data photos --views 3 | 0 to 2
2 | render scene.ply -o out --from 1,2 | --from
2 | render scene.ply -o out --data photos --from 0,0,1 | --from
2 | render scene.ply -o out --count 1 --region auto | --prompt
2 | render scene.ply -o out --count 1 --prompt 'as gold' | --region
2 | render scene.ply -o out --count 1 --region box:1,2,3 | 6 finite numbers
2 | render scene.ply -o out --count 1 --region sphere:1e7,0,0,1 | no Gaussian
3 | render scene.ply -o out --count 1 --region flags7.npy | 5 Gaussians
2 | render none.ply -o a.jpg | name a folder
2 | render none.ply -o a.png --path orbit | one picture
2 | render none.ply -o a.png --count 2 | --count
2 | render none.ply -o a.npy --show color,depth | one map
2 | render none.ply -o a.exr --format exr | --format
2 | render none.ply -o out --show colour | color, depth
2 | render none.ply -o out --resolution 640 | 1280x720
2 | render none.ply -o out --background blakc | color
2 | render none.ply -o a.gif --background transparent | PNG
2 | render none.ply -o out --show alpha --background transparent | color
2 | render none.ply -o a.png --show color,depth --background transparent | folder
2 | render none.ply -o a.gif --fps 60 | at most 50
2 | render none.ply -o out --frames 9 | --path
2 | render none.ply -o a.png --arc 90 | --arc
2 | render none.ply -o a.gif --path spline --set elevation=9 | spline
2 | render none.ply -o out --path orbit --fps 9 | --fps
2 | render none.ply -o a.gif --set crf=18 | crf
2 | render none.ply -o a.mp4 --crf 18 | --set crf
2 | render none.ply -o out --wipe b.ply --show color,depth | --wipe
2 | render none.ply -o a.exr --wipe b.ply | --wipe
2 | render none.ply -o out --wipe b.ply --region all | --wipe
2 | render none.ply -o out --path circle | circle
2 | view scene.ply -o a.jpg | a.jpg
2 | view scene.ply -o a.png --up w | up axis
2 | view scene.ply -o taken.png | -f

3 | diff scene.ply none.ply | none.ply
2 | diff scene.ply other.ply -o a.jpg | .png
2 | diff scene.ply other.ply --look-at 1,2 | 3 finite numbers
2 | measure scene.ply | --at
2 | measure scene.ply --at 0,0,0 | --height
2 | measure scene.ply --at 0,0,0 --at nowhere | a column and a row
2 | measure scene.ply --at 0,0,0 --region auto | --at
2 | measure scene.ply --at 1,1,1 --at 1,1,1 | two places
2 | metrics scene.ply | --against
3 | metrics scene.ply --against gone.ply | gone.ply
3 | metrics scene.ply --against empty | empty
2 | metrics scene.ply --against pictures | from where
2 | metrics scene.ply --against edit --data x | --data
3 | metrics scene.ply --against edit/views.json | --views
2 | metrics scene.ply --against edit --region auto | region.npy
2 | metrics empty | edit.json
"""
"""Exit code, command line and a word of its message; CLICK, EDIT and ROOM stand for the above."""


@pytest.fixture(scope="module")
def place(room, tmp_path_factory) -> Path:
    """A folder with scenes, photos, an edit, and files that no command may replace unasked."""
    place = tmp_path_factory.mktemp("place")
    table = scene_table()
    for name in ("scene", "other"):
        (place / f"{name}.ply").write_bytes(ply_bytes(table))
    table[3, PLY_COLUMNS.index("y")] = np.nan
    (place / "bad.ply").write_bytes(ply_bytes(table))
    dataset(place / "photos")
    for folder in ("taken", "empty", "ended", "pictures", "exported"):
        (place / folder).mkdir()
    for name in ("taken.ply", "taken.png", "taken/note", "ended/checkpoint.safetensors"):
        (place / name).write_text("mine")
    Image.new("RGB", (8, 8)).save(place / "pictures/0.jpg")
    (place / "exported/dataparser_transforms.json").write_text("{}")
    for count in (5, 7):
        np.save(place / f"flags{count}.npy", np.arange(count) < 3)
    (place / "link").symlink_to("missing")
    (place / "here").symlink_to(place)
    words = ("20% brighter", "--data", place / "photos", "-o", place / "edit")
    done = gsedit("edit", place / "scene.ply", *words)
    assert done.exit_code == 0, done.stderr
    means = load(place / "scene.ply").means.numpy()
    save_named(np.arange(5) == 1, means[::-1].copy(), place / "scene.ply", "hat")
    shutil.copytree(room, place / "room")
    means = load(place / "room/room.ply").means.numpy()
    save_named(np.arange(len(means)) < 50, means, place / "room/room.ply", "ball")
    return place


ROWS = [row.split(" | ") for row in REFUSED.splitlines() if row]


@pytest.mark.parametrize(("code", "words", "told"), ROWS, ids=[words for _, words, _ in ROWS])
def test_a_refusal_is_one_line_and_writes_nothing(code, words, told, place, monkeypatch):
    for name, text in (("CLICK", CLICK), ("EDIT", EDIT), ("ROOM", ROOM)):
        words = words.replace(name, text)
    monkeypatch.chdir(place)
    before = files(place)
    result = gsedit(*shlex.split(words))
    assert result.exit_code == int(code), result.stderr
    *earlier, last = result.stderr.splitlines()
    assert last.startswith("gsedit: ") or not earlier  # the options' own reader names the verb
    assert not any(line.startswith(("gsedit: ", "Traceback")) for line in earlier)
    assert told in last
    assert result.stdout == ""
    assert files(place) == before
    assert not (place / "out").exists()
