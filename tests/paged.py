"""A page of made-up metrics, and a reader of it."""

from html.parser import HTMLParser
from pathlib import Path

from s3le.report import document
from s3le.show import style

ROOT = Path(__file__).parents[1]
LABEL = dict(style.METHODS)
HOSTILE = "</script><img src=x onerror=alert(1)>\"' {0} *a* `b` \u202e\ud800|\n&amp;"


class Reader(HTMLParser):
    """Rows of tables, headings, attributes and all text of a page; it must be well formed."""

    def __init__(self, text: str):
        super().__init__(convert_charrefs=True)
        self.rows, self.open, self.tags, self.text = [], [], [], ""
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag == "tr":
            self.rows.append([])
        if tag in ("th", "td"):
            self.rows[-1].append("")
        if tag not in ("img", "meta", "br"):
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))  # within a drawing

    def handle_endtag(self, tag):
        assert self.open and self.open.pop() == tag, tag

    def handle_data(self, data):
        if "style" in self.open:
            return
        self.text += data
        if {"th", "td"} & set(self.open):
            self.rows[-1][-1] += data


def page_of(tree, training=None, figures=None, **more) -> str:
    return document.page(tree, training or {}, figures or {}, **more)


def row_of(text: str, start: str, after: str = "") -> list[str]:
    """The first row of that name after some piece of the page."""
    rows = Reader(text).rows[text[: text.index(after)].count("<tr>") :]
    return next(row[1:] for row in rows if row and row[0] == start)


def words_of(text: str) -> str:
    return " ".join(Reader(text).text.split())


def method(to_truth, pool, collision_rate=0.0):
    return {"to_truth": to_truth, "to_human": to_truth + 0.0111, "collision_rate": collision_rate,
            "limit_rate": 0.0, "pool": pool}  # fmt: skip


def metrics() -> dict:
    dropped = {"dropped_tilt": 3, "dropped_pelvis": 41, "dropped_bone": 5, "dropped_not_finite": 6}
    return {
        "run": {"robot": "coman", "clips": "demo", "n_dof": 11, "pairs_watched": 378,
                "margin_mm": 2.0},
        "clips": {"train": {"clips": 10, "frames": 923, **dropped}},
        "domain": {"raw": 9001, "mirrored": 9002, "noisy": 81997},
        "pairs": {"rows": 1008, "collided": 252},
        "sampling": {"rows": 100000, "feasible": 1200, "solved": 98000, "fallback": 800,
                     "moved_mean_rad": 0.4321},
        "poses": {"rows": 30000, "accepted_share": 0.215},
        "coverage": {"test": {"uniform": {"mean": 0.0631, "with_pairs": 0.0602},
                              "pairs_alone": {"mean": 0.1269}}},
        "splits": {
            "test": {
                "clips": 5,
                "frames": 512,
                "truth": {"to_human": 0.0123, "collision_rate": 0.0},
                "methods": {
                    "s3le": method(0.06, 131008),
                    "lwl2": method(0.12, 31008),
                    "ale": method(0.15, None, 0.249),
                    "skeleton_all": method(0.04, 131008),
                },
            }
        },
    }  # fmt: skip


def latency(**more) -> dict:
    """A record of times as benchmarks/online.py writes it."""
    return {
        "format": 1, "date": "2026-01-02", "machine": "a machine", "threads": 1, "robot": "coman",
        "robot_tag": "coman 1234 margin=0.002 neck=midpoint", "joints": 11, "pairs": 378,
        "method": "s3le, l2", "check": True, "settings": {"k": 8}, "frames": 300,
        "modes": {"refined": 0.75},
        "rows": [
            {"part": "encoder", "calls": 200, "us_p50": 54.25, "us_p99": 99.0, "us_worst": 120.0},
            {"part": "whole", "calls": 300, "us_p50": 410.0, "us_p99": 1020.0, "us_worst": 6900.0},
        ],
    } | more  # fmt: skip


# --- what it says


def segments(collide=12, feasible=235, fast=118, **more):
    """Figures of what lies between frames, as evaluation.summary gives them."""
    total = 235
    return {
        "segments": total, "segments_feasible": feasible, "segments_colliding": collide,
        "segments_undecided": 0, "segments_too_fast": fast, "segment_margin_mm": 0.5,
        "segment_collision_rate": collide / feasible if feasible else None,
        "segment_undecided_rate": 0.0 if feasible else None,
        "segment_uncertified_rate": 0.0625, "segment_too_fast_rate": fast / total,
        "largest_jump_rad": 3.5141, "limited_rate": 0.2,
        "avoiding_rate": 0.01, "held_rate": 0.0, "proposed_by": "s3le",
    } | more  # fmt: skip


def certified(proposed_by="s3le", **more):
    tree = metrics()
    own = tree["splits"]["test"]["methods"]
    own["s3le"] |= segments()
    own["ale"] |= segments(feasible=0, collide=0, proposed_by="ale")
    for key in ("certified_lookup", "certified_refined"):
        own[key] = method(0.02, 131008) | segments(0, fast=0, proposed_by=proposed_by) | more
    return tree
