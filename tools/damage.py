# SPDX-License-Identifier: MIT
"""Random damage to XML files, for tests of imports: values, names, elements and their order are changed, and files are cut."""

import re

VALUES = ("", "nan", "0", "-1", "1e300", "1e30", "1e-320", "0 0 0", "1 2 3", "0 0 0 0", "true", "hinge", "door", "rod", "fixed", "box", "\u00e9",
          "'", "&#10;", "x"*300)


def damaged(text: str, random) -> str:
    """A file with 1 to 8 changes drawn by `random`."""
    for _ in range(random.choice((1, 1, 1, 2, 3, 8))):
        attributes = list(re.finditer(r'(\w+)="([^"]*)"', text))
        elements = list(re.finditer(r"<(\w+)[^<>]*/>", text))
        kind = random.randrange(9)
        if kind < 4 and attributes:
            one = random.choice(attributes)
            text = text[:one.start(2)] + random.choice(VALUES) + text[one.end(2):]
        elif kind == 4 and attributes:
            one = random.choice(attributes)
            text = text[:one.start()] + text[one.end():]
        elif kind == 5 and attributes:
            one, other = random.choice(attributes), random.choice(attributes)
            text = text[:one.start(1)] + other[1] + text[one.end(1):]
        elif kind == 6 and elements:
            one, other = random.choice(elements), random.choice(elements)
            text = text[:one.start()] + other[0] + random.choice(("", one[0])) + text[one.end():]
        elif kind == 7 and elements:
            one, other = random.choice(elements), random.choice(elements)
            text = text[:one.start(1)] + other[1] + text[one.end(1):]
        elif kind == 8 and random.random() < 0.3:
            place = random.randrange(len(text))
            text = text[:place] + random.choice(("", "<", "\0", "</body>", text[place + random.randrange(50):]))
    return text
