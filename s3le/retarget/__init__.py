"""From seven unit vectors to a certified pose by a certified step: retrieve, refine, guard."""
