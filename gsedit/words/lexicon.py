"""Words that a sentence is read by: tones, materials, lights, looks, finishes and plain words.

A phrase is one to four lower-case words. Every entry stands once; what is said with a color's name
is read by `gsedit.words.colors`.
"""

from __future__ import annotations


def listed(table: dict[str, str]) -> dict[str, str]:
    """Meaning by phrase, from phrases separated by commas by meaning."""
    return {phrase.strip(): meaning for meaning, row in table.items() for phrase in row.split(",")}


def word_set(text: str) -> frozenset[str]:
    """Words of a text between its spaces."""
    return frozenset(text.split())


TONE_NOUNS = listed(
    {
        "brightness": "brightness, exposure, luminosity, lightness, illumination, gamma",
        "contrast": "contrast, contrasts, punch",
        "saturation": "saturation, vibrance, vibrancy, chroma, color, colors, coloring, "
        "colorfulness, palette",
        "warmth": "warmth, color temperature, temperature, white balance",
        "hue": "hue, hues, tint",
    }
)
TONE_WORDS = listed(
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
TONE_TURNS = listed(
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
TONE_STYLES = listed(
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
FINISHES = listed(
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

LIGHTS = listed(
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
LOOK_NAMES = listed(
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
