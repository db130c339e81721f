"""The looks that the closed-form editor can apply, each in three variants."""

from __future__ import annotations

from dataclasses import dataclass

from gsedit.editors.looks.color_maps import (
    ColorMap,
    cartoon,
    foliage,
    grained,
    ramp,
    sketch,
    snow,
    veined,
    watercolor,
)

VARIANTS = 3


@dataclass(frozen=True)
class Look:
    """Words that ask for a look, and its variants."""

    words: tuple[str, ...]
    """Lower case; a word may be a phrase. Their order is of no meaning."""
    variants: tuple[ColorMap, ColorMap, ColorMap]


LOOKS: dict[str, Look] = {
    "bronze": Look(
        ("bronze", "brass", "bronzed"),
        (
            ramp("140a04 5a3414 b07a2c f0c878 fff4d0"),  # polished, golden brown
            ramp("080504 2a1810 5c3a26 9c6c4a e8c8a4"),  # dark
            ramp("06120f 1c4a40 4c9484 96ccb4 ecf4dc", keep=0.15),  # green patina
        ),
    ),
    "gold": Look(
        ("gold", "golden", "gilded"),
        (
            ramp("2a1600 8a5400 e0a010 ffdc50 fffbd8"),  # yellow gold
            ramp("2a0e0a 8c4438 d88c78 f8c8b4 fff4ec"),  # rose gold
            ramp("161206 4c4414 8c8030 c8c070 f8f4cc"),  # old green gold
        ),
    ),
    "silver": Look(
        ("silver", "chrome", "steel", "metal", "metallic", "iron", "platinum"),
        (
            ramp("08090c 43484f 8a919a a9b0b8 dfe4ea ffffff", keep=0.03, contrast=0.8),
            ramp("040608 16202c 34485c 6a8298 a8bccc f0f8ff", keep=0.03, contrast=0.8),
            ramp("0c0a0a 5e544e a8988a c4b6a6 ecdcca fffaf4", keep=0.03, contrast=0.8, gamma=0.9),
        ),
    ),
    "marble": Look(
        ("marble", "porcelain", "alabaster"),
        (
            veined("5c5c62 b4b4b8 e4e2de fbfaf6 ffffff", "54565e"),  # Carrara
            veined("060608 1c1c20 3c3c42 6c6a70 d0ccc8", "e8dcc0"),  # black, gold veins
            veined("4c2c28 a87068 dca89c f4d8cc fff6f0", "8c3c38"),  # rose
        ),
    ),
    "stone": Look(
        ("stone", "granite", "rock", "concrete", "limestone", "sandstone"),
        (
            ramp("18181a 4c4c4c 808080 acaca8 dcdcd4", keep=0.03, contrast=0.4),  # granite
            ramp("38281a 806448 c0a078 e4d0a8 f8f0d8", keep=0.06, contrast=0.4),  # sandstone
            ramp("0c1014 28343c 485864 78888c b8c4c4", keep=0.03, contrast=0.4),  # slate
        ),
    ),
    "wood": Look(
        ("wood", "wooden", "oak", "timber"),
        (
            grained("241004 6c3c14 b07838 dcb070 f8e0b0"),  # oak
            grained("0c0402 301408 5c2c16 90543a d0a080"),  # walnut
            grained("3c2c18 907848 d0b880 ecdcb0 fff8e0"),  # birch
        ),
    ),
    "snow": Look(
        ("snow", "snowy", "snowing", "snowfall", "snowed", "winter", "wintry", "blizzard"),
        (
            snow("6c7c90", "f8fbff", depth=0.22),  # a clear morning
            snow("3c5878", "b4d0f4", depth=0.22),  # blue shade
            snow("8c5c68", "ffd8c0", depth=0.26),  # evening light
        ),
    ),
    "night": Look(
        ("night", "nighttime", "midnight", "moonlight", "moonlit"),
        (
            ramp("01030c 0a1838 24447c 6890c8 d8ecff", keep=0.15, contrast=0.7, gamma=1.9),
            ramp("02080a 06282c 145c5c 48a498 d0fff0", keep=0.15, contrast=0.7, gamma=1.9),
            ramp("08020e 240c3c 54287c 9c68c0 f4dcff", keep=0.15, contrast=0.7, gamma=1.9),
        ),
    ),
    "autumn": Look(
        ("autumn", "autumnal", "fall foliage", "october"),
        (
            foliage("8c3c08 e88c1c ffd870", "ffecd0"),  # amber
            foliage("64100c c4301c f89060", "ffd8cc"),  # crimson
            foliage("847008 e8cc28 fff8a0", "fcf8c8"),  # yellow
        ),
    ),
    "sepia": Look(
        ("sepia", "vintage", "old photo", "old photograph"),
        (
            ramp("1c1008 644830 ac8c64 e0c8a0 fff4dc", keep=0.0, contrast=0.4),
            ramp("0c0a0c 3c2c2c 745858 b49490 ecd4c8", keep=0.0, contrast=0.4),
            ramp("302810 88784c c8bc88 ece4bc fffce8", keep=0.0, contrast=0.2, gamma=0.8),
        ),
    ),
    "sketch": Look(
        ("sketch", "sketched", "pencil", "drawing", "charcoal"),
        (
            sketch("1c1c20", "fcfcf8"),  # graphite
            sketch("0c2468", "e4ecf8"),  # blue ink
            sketch("6c1c0c", "f4dcc0"),  # red chalk
        ),
    ),
    "black-and-white": Look(
        ("black and white", "monochrome", "grayscale", "greyscale", "noir", "b w"),
        (
            ramp("000000 404040 808080 c0c0c0 ffffff", keep=0.0, contrast=0.8),
            ramp("000000 141414 343434 6c6c6c f0f0f0", keep=0.0, contrast=0.9),  # low key
            ramp("303030 8c8c8c c8c8c8 ececec ffffff", keep=0.0, contrast=0.4),  # high key
        ),
    ),
    "neon": Look(
        ("neon", "cyberpunk", "synthwave", "vaporwave"),
        (
            ramp("060014 3c0868 d01890 ff68b8 80f8ff", keep=0.5, contrast=0.8),  # magenta
            ramp("000814 04385c 0898b4 30f8d8 f0ff80", keep=0.5, contrast=0.8),  # cyan
            ramp("0c0018 2c1090 7048f8 f070ff fff0a0", keep=0.5, contrast=0.8),  # violet
        ),
    ),
    "clay": Look(
        ("clay", "terracotta", "ceramic", "pottery", "plasticine"),
        (
            ramp("2c0e06 803420 c86c48 e8a880 fce4cc", keep=0.06),  # terracotta
            ramp("282420 6c645c a89c90 d0c8bc f4f0e8", keep=0.06),  # grey clay
            ramp("442808 a06c28 dcac60 f4d8a0 fff8e0", keep=0.06),  # ochre
        ),
    ),
    "ice": Look(
        ("ice", "icy", "frozen", "frost", "frosty", "glacier", "crystal"),
        (
            ramp("082844 2c74a8 74bce4 c0e8fc ffffff", keep=0.08),  # blue
            ramp("0c3438 3c9090 90d8d0 d4f8f0 ffffff", keep=0.08),  # green
            ramp("282850 6468a8 a4a8e0 dcdcfc ffffff", keep=0.08),  # violet
        ),
    ),
    "jade": Look(
        ("jade", "emerald", "malachite"),
        (
            ramp("041c10 14603c 48ac74 a0dcac f0fff0", keep=0.05),  # green
            ramp("020c08 083424 145c40 34906c a0d8bc", keep=0.05),  # dark
            ramp("34401c 88985c c4d098 e8f0cc fffff4", keep=0.05),  # pale
        ),
    ),
    "lava": Look(
        ("lava", "fire", "fiery", "burning", "magma", "volcanic", "flames", "ember", "embers"),
        (
            ramp("0c0202 500804 d03404 ff9c10 fff8a0", keep=0.08, contrast=0.8),  # red
            ramp("040208 180c54 2058d0 48b8ff f0ffff", keep=0.08, contrast=0.8),  # blue flame
            ramp("140802 743404 e88c08 ffdc40 fffff0", keep=0.08, contrast=0.5, gamma=0.8),
        ),
    ),
    "watercolor": Look(
        ("watercolor", "watercolour", "aquarelle", "watercolors", "painting"),
        (
            watercolor("fff4e0", 1.9),  # warm paper
            watercolor("c8e0ff", 1.6),  # cool wash
            watercolor("ffccd0", 1.6),  # rose wash
        ),
    ),
    "cartoon": Look(
        ("cartoon", "comic", "anime", "toon", "pixar"),
        (
            cartoon(5, 2.2, 0.75, "fff8e8"),
            cartoon(4, 2.4, 1.2, "e8f0ff"),
            cartoon(5, 1.6, 0.55, "ffe0e8"),
        ),
    ),
    "sunset": Look(
        ("sunset", "sunrise", "dusk", "golden hour", "dawn", "evening"),
        (
            ramp("180c20 64283c d06440 ffb45c fff4c0", keep=0.5),  # orange
            ramp("100c2c 50286c b44c88 f89090 ffe4c0", keep=0.5),  # purple
            ramp("201408 70440c d89c28 ffdc70 fffce0", keep=0.5),  # gold
        ),
    ),
    "rust": Look(
        ("rust", "rusty", "rusted", "corroded"),
        (
            ramp("100806 4c2010 9c4818 cc7c38 e8c498", keep=0.15),
            ramp("0a0808 281c1c 54342c 84584c c0a090", keep=0.15),
            ramp("101814 3c5048 846c48 d08840 f8e0b0", keep=0.15),
        ),
    ),
}
"""By name, in the order in which they are listed. Variants differ at a glance."""
