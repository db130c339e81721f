"""Wordings of each look: those of the training prompts, and those held out for evaluation.

A look has four forms of wording: things ("a bronze statue"), states ("made of bronze"), orders
("give {it} a bronze finish") and changes that fit "make it ..." ("bronze").
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Wording:
    """Phrases for one look. `{it}` stands for the subject."""

    things: tuple[str, ...] = ()
    """Fit "turn it into ..." and "as ..."."""
    states: tuple[str, ...] = ()
    """Fit "show it ..." and stand alone."""
    orders: tuple[str, ...] = ()
    """Wordings that are whole commands."""
    changes: tuple[str, ...] = ()
    """Fit "make it ..."."""
    held_out_things: tuple[str, ...] = ()
    held_out_states: tuple[str, ...] = ()
    held_out_orders: tuple[str, ...] = ()

    def fragments(self) -> tuple[str, ...]:
        """All phrases of the training prompts, with "it" as the subject."""
        phrases = (*self.things, *self.states, *self.orders, *self.changes)
        return tuple(dict.fromkeys(phrase.format(it="it") for phrase in phrases))


def _article(noun: str) -> str:
    return f"{'an' if noun[0] in 'aeiou' else 'a'} {noun}"


def _material(
    stuff: str, made: str, *, adjective: str = "", also: str = "", more: tuple[str, ...] = ()
) -> Wording:
    """A solid material: noun (`stuff`), participle that goes with it (`made`), adjective, a second
    noun, more states."""
    adjective, also = adjective or stuff, also or stuff
    return Wording(
        things=(
            f"{_article(adjective)} statue",
            f"{_article(adjective)} sculpture",
            f"a statue made of {also}",
            f"{_article(adjective)} figure",
        ),
        states=(f"made of {stuff}", f"{made} {stuff}", f"in {also}", *more),
        orders=(f"make {{it}} out of {also}", f"replace {{it}} with {_article(adjective)} copy"),
        changes=(stuff, adjective, f"look like {stuff}", f"look {adjective}"),
        held_out_things=(f"a sculpture of pure {stuff}", f"something made entirely of {stuff}"),
        held_out_states=(f"in solid {stuff}",),
        held_out_orders=(f"use {stuff} for {{it}}", f"change the material of {{it}} to {stuff}"),
    )


def _paint(colour: str, shade: str) -> Wording:
    """A plain paint, and another word for its colour (with the colour's own name)."""
    return Wording(
        things=(f"{_article(colour)} statue", f"{_article(colour)} one", f"a {shade} toy"),
        states=(f"painted {colour}", f"in {colour} paint", f"covered in {colour} paint"),
        orders=(
            f"paint {{it}} {colour}",
            f"color {{it}} {colour}",
            f"colour {{it}} {colour}",
            f"give {{it}} a coat of {colour} paint",
            f"spray {{it}} {colour}",
        ),
        changes=(colour, shade),
        held_out_things=(f"something painted all {colour}",),
        held_out_states=(f"with {colour} paint all over",),
        held_out_orders=(f"use {colour} paint on {{it}}", f"cover {{it}} with {colour} color"),
    )


def _worded(things: str, states: str, orders: str, changes: str, held_out: str) -> Wording:
    """From phrases separated by bars; of the held-out ones, orders start with a plus."""
    split = [tuple(part.strip() for part in text.split("|")) for text in (things, states)]
    held_out_parts = tuple(part.strip() for part in held_out.split("|"))
    return Wording(
        *split,
        orders=tuple(part.strip() for part in orders.split("|")),
        changes=tuple(part.strip() for part in changes.split("|")),
        held_out_states=tuple(part for part in held_out_parts if not part.startswith("+")),
        held_out_orders=tuple(part[1:] for part in held_out_parts if part.startswith("+")),
    )


WORDINGS: dict[str, Wording] = {
    "bronze": _material("bronze", "cast in", adjective="bronze"),
    "gold": _material("gold", "cast in", adjective="golden", more=("gilded",)),
    "silver": _material("silver", "cast in", also="polished silver", more=("in chrome",)),
    "verdigris": _material(
        "verdigris",
        "covered in",
        also="green weathered copper",
        more=("with a green copper patina",),
    ),
    "rust": _material(
        "rust", "covered in", adjective="rusty", also="rusted iron", more=("rusted",)
    ),
    "marble": _material("marble", "carved from", also="white veined marble"),
    "sandstone": _material("sandstone", "carved from", also="yellow sandstone"),
    "slate": _material("slate", "carved from", also="dark grey stone"),
    "wood": _material("wood", "carved from", adjective="wooden"),
    "terracotta": _material("terracotta", "molded in", also="terracotta clay"),
    "chocolate": _material("chocolate", "molded in", also="dark chocolate"),
    "porcelain": _material("pink porcelain", "molded in", also="glazed pink porcelain"),
    "jade": _material("jade", "carved from", also="polished jade"),
    "ice": _material("ice", "carved from", adjective="icy", also="frozen ice", more=("frozen",)),
    "lava": _material("lava", "made from", also="glowing lava"),
    "moss": _worded(
        "a mossy statue | a moss covered statue | an overgrown statue",
        "covered in moss | overgrown with moss | under a layer of moss",
        "cover {it} in moss | let moss grow on {it} | grow moss over {it}",
        "mossy | overgrown | look mossy",
        "with moss all over | hidden under moss | +put moss on {it}",
    ),
    "red": _paint("red", "bright red"),
    "orange": _paint("orange", "bright orange"),
    "yellow": _paint("yellow", "bright yellow"),
    "green": _paint("green", "bright green"),
    "blue": _paint("blue", "deep blue"),
    "purple": _paint("purple", "deep purple"),
    "pink": _paint("pink", "hot pink"),
    "white": _paint("white", "plain white"),
    "black": _paint("black", "jet black"),
    "snow": _worded(
        "a snowy scene | a winter scene | a snowy winter day",
        "in the snow | in winter | covered in snow | after a snowfall",
        "make it snow | add snow | let it snow | put snow on everything",
        "snowy | look like winter | wintry",
        "under fresh snow | on a cold snowy winter morning | +bring snow and winter",
    ),
    "fog": _worded(
        "a foggy morning | a misty scene | a foggy scene",
        "in the fog | in thick fog | in the mist | on a foggy day",
        "add fog | add mist | fill it with fog | let fog roll in",
        "foggy | misty | hazy with fog",
        "lost in dense grey fog | on a misty foggy evening | +bring in some thick mist",
    ),
    "rain": _worded(
        "a rainy day | a wet rainy scene | a rainy scene",
        "in the rain | on a rainy day | under a grey rainy sky | after the rain",
        "make it rain | add rain | let it rain | make everything wet",
        "rainy | overcast | wet and rainy",
        "during heavy rain | on a wet overcast day | +bring rain and a gray sky",
    ),
    "desert": _worded(
        "a dusty desert | a sandstorm | a desert scene",
        "in the desert | in a sandstorm | in desert dust | in a cloud of dust",
        "add desert dust | make it a sandstorm | cover everything in sand | move it to the desert",
        "dusty | sandy | look like a desert",
        "among blowing sand and dust | deep in a sandy desert | +blow desert sand over everything",
    ),
    "underwater": _worded(
        "an underwater scene | a scene under the sea | an underwater photo",
        "underwater | under the sea | at the bottom of the ocean | deep under water",
        "put it underwater | sink it in the sea | flood it with sea water",
        "underwater | look underwater | look like it is under the sea",
        "below the ocean water | down in the deep sea | +sink everything underwater",
    ),
    "night": _worded(
        "a night scene | a dark night | a moonlit night",
        "at night | in the moonlight | at midnight | on a dark night",
        "make it night | turn day into night | make it nighttime",
        "night | look like night | nighttime",
        "late at night by moonlight | during the night | +bring on the night",
    ),
    "sunset": _worded(
        "a sunset scene | a warm evening | an evening scene",
        "at sunset | at dusk | in the evening light | during golden hour",
        "make it sunset | add a sunset | give it a sunset light",
        "sunset | look like sunset | look like evening",
        "in the late evening at sunset | lit by a warm sunset | +bring on dusk with a sunset sky",
    ),
    "autumn": _worded(
        "an autumn scene | an autumn day | a fall scene",
        "in autumn | in the fall | among autumn leaves | in october",
        "make it autumn | add autumn leaves | turn the leaves orange | make it fall",
        "autumn | look like autumn | autumnal",
        "on a fall day in autumn | with orange fall leaves | +bring autumn leaves everywhere",
    ),
    "spring": _worded(
        "a spring scene | a lush green meadow | a spring day",
        "in spring | in springtime | on lush green grass | on a green meadow",
        "make it spring | add green grass | let grass grow everywhere | make the grass green",
        "spring | lush and green | look like spring",
        "on a fresh green day in spring | with lush grass everywhere | +bring spring and grass",
    ),
    "sketch": _worded(
        "a pencil sketch | a pencil drawing | a sketch | a charcoal drawing",
        "in the style of a pencil sketch | drawn in pencil | in pencil",
        "draw it in pencil | sketch it | make a pencil sketch of {it}",
        "a sketch | look like a pencil drawing | a pencil sketch",
        "drawn as a rough sketch with a pencil | in pencil drawing style | +draw a sketch of {it}",
    ),
    "watercolor": _worded(
        "a watercolor painting | a watercolour painting | a watercolor | a watercolour",
        "in the style of a watercolor | painted in watercolor | in watercolour",
        "paint it in watercolors | make a watercolor of {it} | paint it in watercolours",
        "a watercolor | look like a watercolour | a watercolor painting",
        "done in soft watercolor paint | in watercolor style | +use watercolor to paint {it}",
    ),
    "cartoon": _worded(
        "a cartoon | a comic | a cartoon drawing | a comic book picture",
        "in the style of a cartoon | in a comic book | drawn as a cartoon",
        "make a cartoon of {it} | draw it as a cartoon | cartoonize it",
        "a cartoon | look like a cartoon | cartoonish",
        "in cartoon style | from a comic or cartoon | +make it into a comic cartoon",
    ),
    "pop-art": _worded(
        "a pop art poster | pop art | a pop art print",
        "in the style of pop art | in pop art style | printed as pop art",
        "make a pop art poster of {it} | print it as pop art | posterize it",
        "pop art | look like pop art | a pop art poster",
        "printed like pop art posters | with pop art colors | +make it into a print of pop art",
    ),
    "blueprint": _worded(
        "a blueprint | a blueprint drawing | an architect's blueprint",
        "in the style of a blueprint | drawn as a blueprint | on a blueprint",
        "draw a blueprint of {it} | draw it as a blueprint | make a blueprint of {it}",
        "a blueprint | look like a blueprint | a blueprint drawing",
        "in blueprint style | printed on blueprint paper | +put it on a blueprint",
    ),
    "black-and-white": _worded(
        "a black and white photo | a monochrome photo | a grayscale picture",
        "in black and white | in monochrome | in greyscale | without color",
        "remove the colors | remove the colours | take all the colour out",
        "black and white | monochrome | grayscale",
        "with no color but black and white | on black and white film | +use only black and white",
    ),
    "sepia": _worded(
        "a sepia photo | an old sepia photograph | a vintage photo",
        "in sepia | in sepia tones | in the style of an old photograph",
        "add a sepia tone | make an old photo of {it} | age the photo to sepia",
        "sepia | look like an old sepia photo | vintage",
        "in vintage sepia style | on old sepia paper | +give everything a sepia look",
    ),
    "neon": _worded(
        "a neon scene | a cyberpunk scene | a neon city",
        "in neon light | in neon colors | in the style of cyberpunk | in neon colours",
        "add neon lights | light it with neon | make it cyberpunk",
        "neon | cyberpunk | glow with neon",
        "lit by neon in a cyberpunk city | in cyberpunk style | +bring in cyberpunk neon lights",
    ),
    "thermal": _worded(
        "a thermal image | a heat map | an infrared heat picture",
        "in thermal vision | seen by a thermal camera | as seen in infrared",
        "make a thermal image of {it} | make a heat map of {it} | show the heat",
        "thermal | look like a thermal image | infrared",
        "in infrared heat vision | through a thermal infrared camera | +use a thermal camera",
    ),
    "negative": _worded(
        "a photo negative | a negative | a film negative",
        "in negative | with inverted colors | with inverted colours | as on a film negative",
        "invert the colors | invert the colours | invert it",
        "negative | inverted | look like a film negative",
        "on negative film | in inverted negative colors | +make every color inverted",
    ),
    "polaroid": _worded(
        "a polaroid | a faded polaroid | a faded old polaroid photo",
        "in the style of a polaroid | on a faded polaroid | in faded colors",
        "fade the colors | fade it like a polaroid | make a polaroid of {it}",
        "faded | look like a polaroid | a polaroid",
        "in faded polaroid style | on polaroid film | +give it the faded look of a polaroid",
    ),
    "warmer": _worded(
        "a warmer picture | a picture with warm colors | a warm toned picture",
        "in warmer colors | in warm tones | with warmer light | with a warm tint",
        "make the colors warmer | add warmth | warm it up | make the colours warmer",
        "warmer | warm | a bit warmer",
        "in a warm color tone | with a warmer look | +use warmer colors",
    ),
    "cooler": _worded(
        "a cooler picture | a picture with cool colors | a cool toned picture",
        "in cooler colors | in cool tones | with cooler light | with a cold blue tint",
        "make the colors cooler | cool it down | cool the tones | make the colours cooler",
        "cooler | colder | a bit cooler",
        "in a cold cool color tone | with a cooler look | +use cooler colors",
    ),
    "brighter": _worded(
        "a brighter picture | a bright picture | a brighter photo",
        "in brighter light | with more light | overexposed | in bright light",
        "brighten it | make everything brighter | add more light | turn the light up",
        "brighter | much brighter | lighter",
        "with brighter and lighter light | in a much brighter look | +brighten everything",
    ),
    "darker": _worded(
        "a darker picture | a dark picture | a darker photo",
        "in dim light | with less light | underexposed | in the dark",
        "darken it | make everything darker | dim the light | turn the light down",
        "darker | much darker | dimmer",
        "with darker dim light | in a much darker look | +darken everything",
    ),
    "high-contrast": _worded(
        "a high contrast picture | a picture with strong contrast | a high contrast photo",
        "in high contrast | with more contrast | with strong contrast | with hard contrast",
        "add contrast | increase the contrast | raise the contrast | turn the contrast up",
        "high contrast | more contrasty | have more contrast",
        "with very high contrast everywhere | in hard contrast style | +give it more contrast",
    ),
    "vivid": _worded(
        "a vivid picture | a colorful picture | a colourful picture",
        "in vivid colors | in vivid colours | with saturated colors | with strong colors",
        "make the colors pop | boost the saturation | saturate the colors | boost the colours",
        "vivid | more colorful | more vivid | more saturated",
        "with very vivid and colorful tones | in saturated vivid style | +use more vivid colors",
    ),
}
"""By name of the look, in the order of TARGET_EDITS."""
