"""Words that a sentence is read by: tones, materials, lights, looks, finishes and plain words.

A phrase is one to four lower-case words. Every entry stands once; what is said with a color's name
is read by `gsedit.words.colors`.
"""

from __future__ import annotations


def _listed(table: dict[str, str]) -> dict[str, str]:
    """Meaning by phrase, from phrases separated by commas by meaning."""
    return {phrase.strip(): meaning for meaning, row in table.items() for phrase in row.split(",")}


def word_set(text: str) -> frozenset[str]:
    """Words of a text between its spaces."""
    return frozenset(text.split())


TONE_NOUNS = _listed(
    {
        "brightness": "brightness, exposure, luminosity, lightness, illumination, gamma",
        "contrast": "contrast, contrasts, punch",
        "saturation": "saturation, vibrance, vibrancy, chroma, color, colors, coloring, "
        "colorfulness, palette",
        "warmth": "warmth, color temperature, temperature, white balance",
        "hue": "hue, hues, tint",
    }
)
TONE_WORDS = _listed(
    {
        "brightness +": "bright, overexposed, blinding, glaring, blown out, over exposed, luminous, "  # noqa: E501
        "glary, well lit",
        "brightness -": "dark, dim, gloomy, darkness, gloom, underexposed, under exposed, murky, "
        "dingy, shadowy, somber, sombre, dusky",
        "contrast +": "contrasty, punchy, high contrast, crisp, contrasted, harsh contrast, crushed",  # noqa: E501
        "contrast -": "flat, low contrast, hazy looking",
        "saturation +": "vivid, vibrant, colorful, saturated, garish, gaudy, lurid, rich, vibrent, "
        "oversaturated, loud",
        "saturation -": "dull, dullness, faded, muted, washed out, subdued, drab, pale, desaturated "  # noqa: E501
        "looking, lifeless, bland, undersaturated, washed, colorless looking",
        "warmth +": "warm, cozy, cosy, sunny looking, toasty",
        "warmth -": "cool, cold, coldness, chilly, icy looking, bluish",
    }
)
"""Adjectives that say how a picture is: of one as bright, too bright, more or less bright."""
TONE_TURNS = _listed(
    {
        "brightness +": "brighter, brighten, brightens, brightening, lighter, lighten, lightens, "
        "brighten up, illuminate, light up",
        "brightness -": "darker, darken, darkens, darkening, dimmer, dimmed, darken down, moodier",
        "contrast +": "contrastier, punchier, deeper blacks, whiter whites, whites whiter, blacks "
        "blacker, deeper shadows, crisper, high contrast look",
        "contrast -": "flatter, flatten",
        "saturation +": "saturate, more saturated, livelier, richer",
        "saturation -": "desaturate, desaturated, desaturation, duller, mute, paler, fade",
        "warmth +": "warmer, warm up, warms, cozier",
        "warmth -": "cooler, colder, cool down, chillier",
    }
)
"""Words that hold their direction."""
TONE_STYLES = _listed(
    {
        "grayscale": "grayscale, greyscale, black and white, monochrome, monochromatic, film noir, "
        "noir, b w, bw, gray scale, grey scale, black white",
        "sepia": "sepia, sepia tone, sepia toned",
        "negative": "negative, invert, inverted, inverted colors, photo negative, invert colors",
    }
)
HUES = {
    "redder": "red",
    "greener": "green",
    "bluer": "blue",
    "yellower": "yellow",
    "pinker": "pink",
    "browner": "brown",
    "purpler": "purple",
    "reddish": "red",
    "greenish": "green",
    "yellowish": "yellow",
    "pinkish": "pink",
    "purplish": "purple",
    "oranger": "orange",
}
PURE = {
    "red": "#ff0000",
    "green": "#00ff00",
    "blue": "#0000ff",
    "yellow": "#ffff00",
    "cyan": "#00ffff",
    "magenta": "#ff00ff",
    "orange": "#ff8000",
    "purple": "#8000ff",
    "pink": "#ff80c0",
    "brown": "#804000",
    "teal": "#008080",
    "violet": "#8000ff",
}
"""Colors toward which hue can turn."""
COLOR_WARMTH = {"orange": 1, "yellow": 1, "amber": 1, "blue": -1}
"""Colors whose surplus is too warm or too cold a white balance."""

UP = word_set(
    "more increase increased increasing raise raised boost boosted higher up add "
    "stronger bump crank push pump "
    "intensify enhance strengthen amplify extra lift elevate turnup deepen improve "
    "gain greater heighten max"
)
DOWN = word_set(
    "less reduce reduced reducing lower lowered decrease decreased decreasing cut "
    "drop down soften softer weaken "
    "weaker fewer diminish lessen minus turndown ease dial tame drain minimize "
    "dampen halve kill strip lose shave "
    "trim drop subtract gentler restrain limit knock"
)
SLIGHT = word_set(
    "slightly slight little bit tad somewhat touch smidge hair gently subtly "
    "subtle mildly shade hint lightly tiny"
)
STRONG = word_set(
    "much lot far really significantly strongly very considerably heavily way "
    "drastically dramatically hugely extremely super greatly massively"
)
INTENSE = {
    "strong": 1,
    "intense": 1,
    "high": 1,
    "heavy": 1,
    "harsh": 1,
    "weak": -1,
    "faint": -1,
    "low": -1,
    "poor": -1,
}
"""Adjectives of a tone's noun, by sign."""
FINISHES = _listed(
    {
        "matte": "matte, matt, mat, chalky, non glossy, unvarnished, dull finish, powdery, "
        "powder coated, velvety",
        "glossy": "glossy, gloss, high gloss, shiny, lacquered, lacquer, varnished, enamel, "
        "glazed, wet look, candy, piano",
        "metallic": "metallic, metal flake, metalflake, pearlescent",
        "satin": "satin, semi gloss, silky, eggshell finish, satiny",
    }
)
MATERIAL_WORDS = word_set(
    "polished brushed weathered aged old rusted rusty frosted worn tarnished "
    "ancient solid pure raw "
    "rough smooth shiny glossy matte matt metallic antique fresh patinated hammered clear carved "
    "molten cracked milk white black dark light glazed stained burnt wet thin thick cast oxidized "
    "corroded frozen veined satin bare varnished fine mirror dull knitted woven gilded"
)
"""Words that stay in a material's name where they stand before it."""

MATERIALS = {
    "bronze": "#8c6239",
    "gold": "#d4a640",
    "silver": "#c0c2c6",
    "copper": "#b5683f",
    "brass": "#b89a4a",
    "iron": "#5a5a5c",
    "steel": "#8f9499",
    "aluminum": "#b9bcc0",
    "chrome": "#c9ccd1",
    "titanium": "#878681",
    "lead": "#6b6e73",
    "tin": "#a8a9ad",
    "pewter": "#8e9294",
    "platinum": "#d5d4d0",
    "metal": "#8f9499",
    "verdigris": "#5f9e8f",
    "rust": "#8b4a26",
    "marble": "#ece9e4",
    "granite": "#8a8784",
    "sandstone": "#c9a878",
    "limestone": "#d3cbb8",
    "slate": "#4f5860",
    "stone": "#8f8b84",
    "concrete": "#9c9a95",
    "brick": "#9c4a34",
    "basalt": "#3c3d3f",
    "obsidian": "#15141a",
    "onyx": "#1c1b1d",
    "alabaster": "#f0e8dc",
    "quartz": "#e4dfe2",
    "plaster": "#eae6de",
    "clay": "#b0714e",
    "terracotta": "#c8643c",
    "porcelain": "#f4f1ec",
    "ceramic": "#e6e0d6",
    "glass": "#cfe0df",
    "crystal": "#dfeaf0",
    "ice": "#c4e1ee",
    "wood": "#8a5a34",
    "bamboo": "#c8ad6a",
    "cork": "#b58a5c",
    "leather": "#6e4428",
    "rubber": "#2c2c2d",
    "plastic": "#d0d0cf",
    "carbon fiber": "#26272a",
    "jade": "#3f9c72",
    "malachite": "#0b8a5c",
    "amethyst": "#8a5fc0",
    "ruby": "#9b1128",
    "emerald": "#1f8f5a",
    "sapphire": "#1f3f9e",
    "lapis lazuli": "#26619c",
    "amber": "#d58a1e",
    "pearl": "#ece6da",
    "ivory": "#f2ead2",
    "bone": "#e3dac6",
    "wax": "#efe2b8",
    "soap": "#ece8d8",
    "chocolate": "#4f2c1a",
    "cheese": "#f2c14e",
    "gingerbread": "#a5652e",
    "sugar": "#f6f3ee",
    "candy": "#f0629a",
    "moss": "#66803a",
    "lava": "#d8481c",
    "sand": "#d6bd8c",
    "snow": "#f4f8fb",
    "mud": "#5f4630",
    "paper": "#f2efe6",
    "cardboard": "#b3895b",
    "wool": "#e6dfd0",
    "velvet": "#6a1b34",
    "felt": "#8b8f94",
    "denim": "#3f5f8a",
    "fabric": "#b9ae9c",
    "butter": "#f6e08a",
    "bread": "#c48a4c",
    "straw": "#d8bf72",
    "gunmetal": "#50565c",
    "coal": "#222224",
    "opal": "#d6e6e6",
    "diamond": "#e8f1f6",
    "turquoise": "#30b5a8",
    "coral": "#f0705c",
    "nickel": "#a5a49c",
    "mercury": "#b8bcc2",
    "jelly": "#d8345a",
    "cloth": "#b9ae9c",
    "foam": "#f0efea",
    "flesh": "#d9a58a",
}
"""Base color of a material."""
MATERIAL_NAMES = {name: name for name in MATERIALS} | _listed(
    {
        "gold": "golden, gilded, midas, solid gold, gilt, 24 karat",
        "silver": "silvery, sterling",
        "copper": "coppery",
        "bronze": "bronzed",
        "rust": "rusty, rusted, rusted iron, rusty iron, corroded, corroded iron, rusty metal, "
        "oxidized iron, corten steel, rusted steel, rusty steel",
        "verdigris": "patina, green patina, patinated copper, oxidized copper, copper patina",
        "aluminum": "aluminium",
        "chrome": "chromed, chrome plated, mirror chrome, chromium",
        "wood": "wooden, oak, walnut, pine, mahogany, teak, timber, ebony, birch, cherry wood, "
        "driftwood, oak wood, cedar, plywood, whittled, maple",
        "stone": "medusa, rock, petrified, stony, fossil",
        "carbon fiber": "carbon fibre, carbon",
        "ice": "icy, frozen, frozen solid, freeze",
        "moss": "mossy, covered in moss, overgrown",
        "lava": "magma, molten lava, molten rock",
        "porcelain": "china, bone china, ming",
        "terracotta": "terra cotta, earthenware, flower pot",
        "concrete": "cement",
        "lapis lazuli": "lapis",
        "glass": "glassy, stained glass",
        "ceramic": "pottery, stoneware",
        "steel": "stainless steel, stainless",
        "crystal": "crystalline",
        "plastic": "vinyl, lego plastic, toy plastic",
        "brick": "bricks",
        "marble": "marbled, carrara, carrara marble",
        "cheese": "cheddar, swiss cheese",
        "chocolate": "milk chocolate, dark chocolate",
        "gingerbread": "ginger bread, cookie, biscuit",
        "candy": "lollipop, gummy, gummi",
        "jelly": "jello, gelatin",
        "wool": "knitted wool, yarn, woolen, woollen, knitted",
        "iron": "cast iron, wrought iron",
        "metal": "metal, sheet metal",
        "straw": "wicker, hay",
        "diamond": "diamonds",
        "ivory": "tusk",
        "leather": "leathery",
        "sugar": "sugar cube, marzipan",
        "plaster": "gypsum, plaster of paris, stucco",
        "fabric": "textile, linen, cotton, silk",
        "wax": "candle wax, beeswax",
        "sand": "packed sand",
    }
)
COLOR_FIRST = word_set(
    "coral turquoise amber ivory pearl ruby emerald sapphire amethyst sand salmon "
    "bone butter straw mud flesh"
)
"""Materials whose name is a color where nothing says that it is made of it."""
SMALL_MATERIALS = {"stone": "sandstone", "snow": "white"} | {
    name: name
    for name in [
        "bronze",
        "gold",
        "silver",
        "verdigris",
        "rust",
        "marble",
        "sandstone",
        "slate",
        "wood",
        "terracotta",
        "chocolate",
        "jade",
        "ice",
        "lava",
        "moss",
    ]
}
"""Look of the editor `small` for a material."""

LIGHTS = _listed(
    {
        "night": "night, nighttime, night time, midnight, nocturnal, after dark, nightfall, "
        "starry night, stars, starlight, nightly",
        "moonlight": "moonlight, moonlit, moon, full moon",
        "dusk": "dusk, twilight, evening, nightfall hour",
        "blue hour": "blue hour",
        "sunset": "sunset, sundown, sun is going down, sun going down, setting sun, sun sets, "
        "sun is setting, sun set, last light, late afternoon",
        "golden hour": "golden hour, magic hour, golden light",
        "sunrise": "sunrise, dawn, early morning, daybreak, sun comes up, morning light, first "
        "light, sun is rising, rising sun, sun up",
        "fog": "fog, foggy, mist, misty, haze, hazy, misted, fogbound",
        "underwater light": "underwater light, caustics",
        "neon": "neon light, neon lights, neon lit, neon, neon signs, cyberpunk, neon glow",
        "cloudy": "cloudy, overcast, cloudy sky, clouds, cloud cover, clouded, gray sky, grey sky",
        "noon": "noon, midday, noon sun, noonday",
        "sunny": "sunny, sunshine, sunlight, sunlit, sunny day, clear day, summer sun",
        "candlelight": "candlelight, candle, candles, candlelit, firelight, campfire, fireplace, "
        "torchlight, bonfire, lantern, candle light",
        "lamp": "lamp, lamp light, lamplight, spotlight, studio light, studio lighting, spot "
        "light, flashlight, street lamp, streetlight, light bulb, softbox, headlight, "
        "floodlight, disco lights, stage light, studio lights",
        "storm": "storm, stormy, thunderstorm, lightning",
        "backlight": "backlit, backlight, rim light, backlighting, silhouette",
        "daylight": "daylight, daytime, into day, to day, daytime light, full day",
    }
)
SMALL_LIGHTS = {
    "night": "night",
    "moonlight": "night",
    "dusk": "sunset",
    "blue hour": "night",
    "sunset": "sunset",
    "golden hour": "sunset",
    "sunrise": "sunset",
    "fog": "fog",
    "underwater light": "underwater",
    "neon": "neon",
    "candlelight": "sunset",
    "storm": "rain",
}
"""Look of the editor `small` for a light."""
LOOK_NAMES = _listed(
    {
        "snow": "snow, snowy, snowfall, blizzard, winter, wintry, snowed in, snow covered, "
        "snowing, snows, january, christmas",
        "rain": "rain, rainy, raining, drizzle, downpour, rainstorm, wet ground, shower, "
        "soaked, pouring, rains, puddles",
        "desert": "desert, sahara, dunes, sand dunes, wasteland",
        "underwater": "underwater, under water, bottom of the sea, ocean floor, under the sea, "
        "atlantis, deep sea, aquarium",
        "autumn": "autumn, autumnal, fall, october, november, fall leaves, fall colors, autumn "
        "leaves, fall foliage",
        "spring": "spring, springtime, cherry blossom, cherry blossoms, blossoms, in bloom, "
        "april, may morning",
        "sketch": "sketch, pencil, pencil drawing, sketchy, sketched, pencil sketch, charcoal "
        "drawing, charcoal sketch, line drawing, drawn, drawing, ink drawing, pen and "
        "ink, doodle, hand drawn, crayon",
        "watercolor": "watercolor, watercolors, watercolor painting, aquarelle, gouache",
        "cartoon": "cartoon, comic, comic book, cartoonish, cartoony, anime, manga, disney, "
        "pixar, cel shaded, graphic novel, simpsons, cel shading, comics, studio "
        "ghibli, ghibli",
        "pop-art": "pop art, warhol, andy warhol, popart, lichtenstein",
        "blueprint": "blueprint, technical drawing, blueprints, technical plan, architectural "
        "drawing",
        "thermal": "thermal, infrared, heat camera, thermal camera, thermal image, thermal "
        "imaging, heat map, heatmap, predator vision, heat vision",
        "polaroid": "polaroid, instant camera, polaroid photo",
        "oil painting": "oil painting, oil on canvas, oil paint, oil paints, van gogh, rembrandt, "
        "painted in oil, oils",
        "impressionist": "impressionist, monet, impressionism, impressionistic",
        "pixel art": "pixel art, 8 bit, pixelated, pixels, pixelart, minecraft, voxel",
        "frost": "frost, frosty, hoarfrost",
        "summer": "summer, summery",
        "mosaic": "mosaic",
        "psychedelic": "psychedelic",
        "cubist": "cubist, picasso, cubism",
        "vintage photo": "vintage photo, vintage, old photo, old photograph, faded photo, retro",
        "woodcut": "woodcut, linocut, engraving, etching, block print",
        "stained glass look": "stained glass window",
        "pointillist": "pointillism, pointillist, seurat",
        "tron": "tron",
        "apocalyptic": "apocalyptic, post apocalyptic, apocalypse",
    }
)
SMALL_LOOKS = {
    name: name
    for name in (
        [
            "snow",
            "rain",
            "desert",
            "underwater",
            "autumn",
            "spring",
            "sketch",
            "watercolor",
            "cartoon",
            "pop-art",
            "blueprint",
            "thermal",
            "polaroid",
        ]
    )
} | {"impressionist": "watercolor", "frost": "snow"}
"""Look of the editor `small` for a look of a sentence."""
