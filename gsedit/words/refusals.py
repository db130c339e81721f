"""Sentences that no route does, each with the reason and the nearest thing that can be done."""

from __future__ import annotations

import re
import unicodedata

from gsedit.words.lexicon import word_set

GEOMETRY = re.compile(
    r"\b(rotate|rotated|bigger|larger|smaller|taller|shorter|thinner|fatter|thicker|"
    r"wider|narrower|longer|shrink|enlarge|resize|rescale|scale it|delete|erase|"
    r"open|close|shut|smile|smiling|dance|dancing|round|square|replace|crop|flip|"
    r"mirror (?:it|the)|bend|tilt|second|another|duplicate|copy|"
    r"wings?|hats?|sunglasses|glasses on|moustache|mustache|beard|move|shift (?:it|"
    r"the \w+) (?:left|right|up|down)|lift (?:the|its) (?:arm|leg|head)|sit|stand "
    r"up|"
    r"lie down|jump|run|walk|fly|wave|write|text|clone|younger|older|furry|fluffier|"
    r"sharpen|blur|zoom|cut off|split|stretch|squash|inflate|melt it|explode|break|"
    r"twice as (?:big|large|tall)|half the size|size|lego version|panda|shape|"
    r"reshape|pose|turn around|look (?:left|right|up)|facing|upside down|wear|"
    r"wearing|crown|"
    r"horns?|add an?other|sword|raise (?:its|his|her) \w+|wink|blink|frown|animate|spin)\b"
)
PARTS = re.compile(
    r"\b(ears?|eyes?|eyebrows?|nose|nostrils?|mouth|lips?|lipstick|teeth|tongue|"
    r"hair|chin|cheeks?|forehead|neck|skin|paws?|claws?|legs?|arms?|hands?|foot|"
    r"feet|fingers?|"
    r"tail|snout|muzzle|belly|back paw|fur|shoulders?|wheels?|tyres?|tires?|rims?|"
    r"seat|saddle|handlebars?|exhaust|pipe|fuel tank|petrol tank|tank|engine|"
    r"headlights?|mirrors?|fender|mudguard|"
    r"spokes?|pedestal|plinth|rocks?(?= (?:red|blue|green|gold|only|white|black))|"
    r"only the rock|legs|top of|bottom of|left half|right half|upper half|lower "
    r"half|edge of|corner of|sky|lawn|grass|trees?|wall|walls|ceiling|"
    r"tabletop|flower pot on|bench|windows?|door|roof|bushes|hedge|path|number "
    r"plate|license plate|collar|beard|glasses|helmet|logo)\b"
)
ACTS = re.compile(r"\b(put|add|place|insert|attach|give|draw|hang|bring|set)\b")
FOREIGN = word_set(
    "mach mache den dem der das des und ist bitte rot blau gruen grun schwarz weiss baer "
    "baren dunkler heller statt haz hazlo la el los las una pon pinta rojo azul oso le les "
    "une rends fais ours rouge bleu en il lo di del della rendi fai rosso tavolo orso marmo "
    "mas o de da maak het een rood beer blauw zet gor niedzwiedzia na czerwono hintergrund "
    "fond fondo estatua statua sombre mettre mets faire colorie colora favor gjor svart rod "
    "bjornen ayiyi yap kirmizi kilise faca urso vermelho vermelha preto noir blanc zwart "
    "wit masa yesil peins verwandle verander auf nacht tisch ein eine"
)
QUESTION = re.compile(
    r"^(who|when|where|why|whose|how (?:much|many|old|far|long|are)|what (?:is|time|"
    r"are|was|day)|which|tell me|is (?:it|there|this)|are you|do you)\b"
)
NEGATION = re.compile(
    r"\b(not|no|without|remove|removing|rid|anything but|any color (?:but|except|"
    r"other)|except|avoid|neither|nor|none|stop|nothing|minus|dont|refuse|instead "
    r"of|rather than|undo|take away|clear (?:away|the|up)|wash off|melt|hide|"
    r"prevent|forbid|nope|lose the|skip)\b"
)
SAY = "gsedit changes color, material, tone, light, weather, season and style"
REASONS = {
    "empty": "the sentence is empty: say what should change, as in 'make it snow'",
    "language": f"only English is read: {SAY}; say it as in 'paint it red'",
    "question": f"this asks for no change: {SAY}; say what should change, as in 'make it warmer'",
    "geometry": f"this would add, remove, move or reshape something: {SAY}; use an editor that "
    f"follows "
    "any sentence: --editor pix2pix --model FOLDER",
    "part": "nothing finds this part of the scene: mark it with --region and say what "
    "changes there, "
    "or name the subject, the background or the whole scene",
    "negation": "this names what must not be, or takes away what no route takes away: say what it "
    "should be instead, as in 'paint it blue'",
    "two": "this names more than one color for one part: say one, as in 'paint it red'",
    "finish": "a finish alone changes nothing: name a color or material with it, as in "
    "'glossy red'",
    "amount": "this amount is out of range: give from -100 % to 900 %, as in 'by 20 %'",
    "nonsense": f"this asks for no change that is known: {SAY}, as in 'a bronze statue at night'",
}
"""Message to a person, by the kind of refusal."""


def first_refusal(sentence: str, text: str) -> str | None:
    """Kind of refusal of a sentence by its letters and language; None for one to be read."""
    letters = [each for each in sentence if each.isalpha()]
    if not letters and not re.search(r"\d", sentence):
        return "empty"
    if sum("LATIN" not in unicodedata.name(each, "") for each in letters) > len(letters) / 3:
        return "language"
    found = re.findall(r"[a-z]+", text)
    hits = sum(word in FOREIGN for word in found)
    if found and hits >= 2 and hits / len(found) >= 0.5:
        return "language"
    return "question" if QUESTION.match(text) else None
