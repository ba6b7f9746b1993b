"""How a row of a retargeted motion was obtained."""

from enum import IntEnum


class Mode(IntEnum):
    """One word a row; every row is certified, whatever its mode."""

    START = 0  # the first pose; nothing leads to it
    REFINED = 1  # the pose wanted, refined towards the human
    LOOKUP = 2  # the pose wanted, as it is stored
    LIMITED = 3  # towards it, as far as the joints get in the time
    SHORTENED = 4  # the first part of a step whose whole could not be proven
    DETOUR = 5  # another way, for the straight one could not be proven
    HELD = 6  # stands still: nothing else could be proven, or no time has passed
    LEAD_IN = 7  # on the way from a given pose to the human's first
    DROPPED = 8  # the frame could not be used; towards the one before it
    EASED = 9  # towards it, as far as the brake lets the joints go
