"""Part of the scene that a text speaks of, put as marker words that no sentence holds."""

from __future__ import annotations

import re

SUBJECT, BACKGROUND, SCENE, IT, PLACE = "<s>", "<b>", "<a>", "<it>", "<p>"
KEEP_SUBJECT, KEEP_BACKGROUND, ONLY = "<ks>", "<kb>", "<only>"
MARKERS = (SUBJECT, BACKGROUND, SCENE, IT, PLACE, KEEP_SUBJECT, KEEP_BACKGROUND, ONLY)

_SUBJECTS = (
    "(?:(?:main )?(?:subject|object|figure)|bear|teddy|statues?|sculpture|face|"
    "table|bike|motorbike|motorcycle|bust|"
    "animal|monument|figurine|idol|person|man|woman|guy|lady|head|thing|dog|cat|"
    "horse|car|chair|vase|fountain|"
    "portrait|foreground)"
)
_PLACES = "(?:garden|park|courtyard|room|yard|street|landscape|outdoors|place|setting)"
_BACKGROUNDS = "(?:background|backdrop|back ground|surroundings?|environment|bg)"
_ALL = (
    "(?:everything|everywhere|all|anything|whole (?:scene|picture|image|thing|"
    "photo|place)|entire (?:scene|picture|image|thing)|scene|picture|image)"
)
_THE = "(?:the |its |my |this |that |his |her |our |your )?"
_S = f"(?:{_THE}(?:\\w+ )?{_SUBJECTS}|it|him|her|me|my face)"
_B = f"(?:{_THE}(?:{_BACKGROUNDS}|{_PLACES}))"
_BUT = (
    "(?:except(?:ing|ion)?|but|apart from|other than|besides|excluding|save|"
    "outside|aside from|bar|minus|not)(?: for| of)?(?: on| in)?"
)
_LEAVE = "(?:leave|keep|spare|preserve|protect|leaving|keeping)"
_TOUCH = (
    "(?:not|without|avoid|no)(?: \\w+)? ?(?:touch|chang|alter|modify|affect|paint|"
    "edit|color)\\w*(?: to| of| in)?"
)
_ELSE = (
    "(?:(?:the )?rest(?: of (?:it|the \\w+))?|everything else|all else|elsewhere|"
    "anything else|others|other things|all other things|nothing else)"
)
_ALONE = (
    "(?: (?:alone|as (?:it|they) (?:is|are|was)|as is|untouched|unchanged|intact|"
    "the same|in color|in full color|natural|original|normal|bright|dark|colorful|warm|vivid|sharp|colored|out(?: of it)?|be))"  # noqa: E501
)
PATTERNS = tuple(
    (re.compile(pattern), f" {put} ")
    for pattern, put in (
        (
            f"\\b(?:(?:with )?the exception of|except(?:ing)?(?: for)?|apart from|other "
            f"than|besides|excluding|aside from) {_S}\\b(?! in\\b)",
            KEEP_SUBJECT,
        ),
        (
            f"\\b(?:(?:with )?the exception of|except(?:ing)?(?: for)?|apart from|other "
            f"than|besides|excluding|aside from) {_B}\\b",
            KEEP_BACKGROUND,
        ),
        (f"\\b({_ALL}(?: \\w+){{0,2}}?) {_BUT} {_S}\\b", KEEP_SUBJECT),
        (f"\\b({_ALL}(?: \\w+){{0,2}}?) {_BUT} {_B}\\b", KEEP_BACKGROUND),
        (
            f"\\b{_LEAVE} {_ELSE}{_ALONE}?|\\b{_TOUCH} {_ELSE}|\\bno changes? {_ELSE}|"
            f"\\bnothing else(?: changes?)?|\\b(?:and )?not {_ELSE}",
            ONLY,
        ),
        (
            f"\\b{_LEAVE} {_S}{_ALONE}|\\b{_TOUCH} {_S}\\b(?! (?:so|too|as|in|red|blue|"
            f"green|black|white|gold)\\b)(?=\\W|$)(?! \\w)|\\b{_LEAVE} {_S}$",
            KEEP_SUBJECT,
        ),
        (f"\\b{_LEAVE} {_B}{_ALONE}|\\b{_TOUCH} {_B}(?=\\W|$)(?! \\w)", KEEP_BACKGROUND),
        (f"(?<!do )\\bnot (?:on |in )?{_B}(?= *(?:$|[,;.:!]))", KEEP_BACKGROUND),
        (f"\\bnot (?:on |in )?(?!it\\b){_S}(?= *(?:$|[,;.:!]))", KEEP_SUBJECT),
        (
            f"\\b{_S} (?:stays|remains|should stay|must stay|should remain|is to stay)(?: \\w+)?",
            KEEP_SUBJECT,
        ),
        (
            f"\\b(?:{_B}) (?:stays|remains|should stay|must stay|should remain)(?: \\w+)?",
            KEEP_BACKGROUND,
        ),
        (
            f"\\b(?:only|just|solely|nothing but|exclusively) (?:on )?(?:for )?{_B}\\b|"
            f"\\b{_B} only\\b",
            f"{KEEP_SUBJECT} {BACKGROUND}",
        ),
        (
            f"\\b(?:only|just|solely|nothing but|exclusively) (?:on )?(?:for )?(?:make |"
            f"paint |turn )?{_S}\\b|\\b{_S} only\\b|\\bonly for {_S}",
            f"{KEEP_BACKGROUND} {SUBJECT}",
        ),
        (
            f"\\b(?:everything |what(?:ever)? is |all |area |stuff |things |the area |"
            f"scenery )*(?:behind|around|surrounding|beyond) (?:of )?{_S}\\b",
            BACKGROUND,
        ),
        (f"\\b{_ELSE}", "<else>"),
        (f"\\b{_THE}{_BACKGROUNDS}\\b", BACKGROUND),
        (
            f"\\b{_THE}(?:(?:whole|entire|full|complete) )?(?:scene|pictures?|image|photo|"
            f"photograph|shot|view|frame)\\b|\\beverything\\b|\\beverywhere\\b|\\b(?:the )"
            f"?(?:whole|entire) (?:thing|lot|place|world|room|garden|park|courtyard)\\b|"
            f"\\ball over\\b|\\ball of it\\b|\\bit all\\b",
            SCENE,
        ),
        (f"\\b(?:(?:in|over|to|of|on|across) )?{_THE}{_PLACES}\\b", PLACE),
        (
            "\\b(?:as|like|into|to) an? (?:\\w+ ){0,3}(?:statue|sculpture|bust|figurine|"
            "figure|thing)\\b(?<!\\w statue of)",
            "<like>",
        ),
        (f"\\b{_THE}{_SUBJECTS}\\b|\\bme\\b", SUBJECT),
        (r"\b(?:it|him|them)\b", IT),
    )
)


def marked(text: str) -> str:
    """Text with markers for parts of the scene; "the rest" is all that a text does not keep."""
    for pattern, put in PATTERNS:
        if "<like>" in put:
            continue
        text = pattern.sub(put, text)
    rest = SUBJECT if KEEP_BACKGROUND in text or BACKGROUND in text else BACKGROUND
    return re.sub(r" +", " ", text.replace("<else>", rest)).strip()
