"""Units of the numbers in files, and lengths as users write them."""

import re

UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254}
"""Units of the numbers in a file [m]."""


def metres_of(text: str) -> float:
    """A length such as "180mm" or "7in" [m].

    Raises:
        ValueError: not a positive number with a unit.
    """
    match = re.fullmatch(rf"\s*(\d+\.?\d*|\.\d+)\s*({'|'.join(UNITS)})\s*", text)
    if match is None or float(match[1]) <= 0.0:
        raise ValueError(f"{text!r} is not a length with its unit ({', '.join(UNITS)}), such as 180mm or 7in")
    return float(match[1]) * UNITS[match[2]]
