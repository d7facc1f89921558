"""Meaning of a label for segmentation: the category that determines its parts."""

from enum import StrEnum

from dcap.scene.text import words_of


class Category(StrEnum):
    """Kinds of things with known parts."""

    BED = "bed"
    SOFA = "sofa"
    CHAIR = "chair"
    STOOL = "stool"
    TABLE = "table"
    CABINET = "cabinet"
    SHELF = "shelf"
    STORAGE = "storage"
    LAMP = "lamp"
    BATHTUB = "bathtub"
    FLAT = "flat"
    STRUCTURE = "structure"
    DUMBBELL = "dumbbell"
    SHOE = "shoe"
    LAPTOP = "laptop"
    PLUSH = "plush"
    PLANT = "plant"
    BASIN = "basin"
    WINDOW = "window"
    OTHER = "other"


TEXT = {
    Category.STRUCTURE: "wall walls floor ceiling room",
    Category.LAMP: "lamp lamps lantern torchiere",
    Category.BASIN: "basin sink washstand washbasin",
    Category.STOOL: "stool ottoman pouf footstool bench",
    Category.SHELF: "shelf shelves bookshelf bookcase bookshelves rack etagere",
    Category.CABINET: "nightstand bedside cabinet wardrobe dresser chest drawer drawers sideboard closet refrigerator "
    "freezer oven washer dishwasher commode vanity box crate trunk counter",
    Category.BED: "bed beds crib cot bunk daybed mattress",
    Category.SOFA: "sofa sofas couch loveseat settee armchair recliner futon",
    Category.CHAIR: "chair chairs seat highchair",
    Category.TABLE: "table tables desk teatable workbench desktop console",
    Category.BATHTUB: "bathtub tub bath",
    Category.FLAT: "rug carpet mat curtain mirror picture painting poster towel",
    Category.DUMBBELL: "dumbbell dumbell barbell",
    Category.SHOE: "shoe sneaker boot sandal slipper shoes trainer",
    Category.LAPTOP: "laptop notebook",
    Category.PLANT: "plant plants flowerpot tree bush cactus",
    Category.STORAGE: "storage shelving",
    Category.WINDOW: "window windows",
    Category.PLUSH: "plush teddy bear koala bunny rabbit doll",
}
"""Words of a label that mean a category, in order of precedence ("bedside table" is a cabinet)."""

WORDS = {category: frozenset(text.split()) for category, text in TEXT.items()}

LEADING = (Category.LAMP, Category.BASIN, Category.STOOL, Category.SHELF, Category.CABINET)
"""Categories that win wherever their word stands: 'lamp_table' is a lamp, a 'bed stool' a stool."""

HANGING = frozenset({"ceiling", "wall", "pendant"})
"""Words for hanging lamps, which have neither base nor pole and are a single part."""

SYNONYMS = {
    "mattress": "mattress", "frame": "frame bedframe footboard", "headboard": "headboard", "pillow": "pillow pillows",
    "blanket": "blanket duvet quilt comforter sheet", "seat cushion": "cushion cushions", "back": "back backrest",
    "arm": "arm arms armrest armrests", "seat": "seat", "leg": "leg legs foot feet", "top": "top tabletop",
    "board": "board boards", "side": "side sides", "shade": "shade lampshade", "pole": "pole stem", "base": "base",
    "rim": "rim", "shell": "shell", "head": "head heads", "handle": "handle", "sole": "sole", "upper": "upper",
    "screen": "screen", "sill": "sill windowsill", "eye": "eye eyes nose", "body": "body drawer drawers",
}  # fmt: skip

PART_WORDS = {word: part for part, text in SYNONYMS.items() for word in text.split()}
"""Part names in node names and the common name of each."""


def category_of(label: str) -> Category:
    """The category of a label: leading words decide wherever they stand, else the last known word.

    A word for structure must come last: a 'wall clock' is not a wall.
    """
    words = words_of(label)
    if HANGING & set(words) and WORDS[Category.LAMP] & set(words):
        return Category.FLAT
    if words and words[-1] in WORDS[Category.STRUCTURE]:
        return Category.STRUCTURE
    for category in LEADING:
        if WORDS[category] & set(words):
            return category
    others = [c for c in WORDS if c is not Category.STRUCTURE]
    return next((c for word in reversed(words) for c in others if word in WORDS[c]), Category.OTHER)


def plain_structure(label: str) -> str:
    """The common name of a structure: 'World Floor' -> 'floor', 'Walls' -> 'wall'."""
    return words_of(label)[-1].removesuffix("s")


def part_word(name: str) -> str:
    """The part named by a node ('Left_Leg' -> 'leg'); empty if there is none."""
    return next((PART_WORDS[word] for word in reversed(words_of(name)) if word in PART_WORDS), "")
