"""The page: not a number invented, and an alarm where something does not hold."""

import math
import re

import pytest
from paged import LABEL, Reader, certified, method, metrics, page_of, row_of, words_of

from s3le.report import cells


def test_page_shows_every_pool_by_every_metric():
    def cell(model, pool, metric, far):
        return {"split": "test", "model": model, "pool": pool, "metric": metric, "stored": 1008,
                "frames": 5, "to_truth": far, "to_human": far}  # fmt: skip

    rows = [
        cell("skeleton", "pairs", "l2", 0.05),
        cell("lwl2", "pairs", "l2", 0.134),
        cell("lwl2", "pairs", "mahalanobis", 0.128),
        cell("lwl2", "all", "l2", 0.109),
    ]
    text = page_of(metrics(), grid=rows)
    assert row_of(text, "nearest skeleton, pairs") == ["0.050", "-", "1,008"]
    assert row_of(text, "LWL2, pairs") == ["0.134", "0.128", "1,008"]
    assert row_of(text, "LWL2, all")[:2] == ["0.109", "-"]
    assert "Which pool, which distance" not in page_of(metrics())


def test_page_holds_the_numbers_it_was_given():
    history = [{"step": 50, "recon_x": 4.0}, {"step": 3950, "recon_x": 0.31}]
    text = page_of(metrics(), {"s3le": history})
    assert row_of(text, "S3LE") == ["0.060", "0.071", "0 %", "0 %", "131,008", "0.040"]
    assert row_of(text, LABEL["ale"]) == ["0.150", "0.161", "24.9 %", "0 %", "-", "-"]
    assert row_of(text, "ground truth") == ["-", "0.012", "0 %", "not measured", "-", "-"]
    assert row_of(text, "train") == ["10", "923", "3", "41", "5", "6"]
    told = words_of(text)
    for piece in ("512 frames", "378", "252 (25.0 %)", "98,000 (98.0 %)", "0.432 rad (24.8°)",
                  "21.5 %", "81,997", "skeletons rebuilt 4 to 0.31", "3,950", "0.1 is 26°",
                  "at least 2 mm", "0.50 times LWL2's (with robot poses)",
                  "1.50 times that of brute force"):  # fmt: skip
        assert piece in told
    assert "must not happen" not in told
    assert text.endswith("\n") and text == page_of(metrics(), {"s3le": history})


def test_key_numbers_stand_above_everything_else():
    text = page_of(certified())
    header = text[text.index("<header>") : text.index("</header>")] + "</header>"
    assert re.findall(r'<p class="big">(.*?)</p>', header) == ["0.020", "0.060", "0.120", "0.150"]
    assert "20° in every direction" in header  # acos(1 - 0.06)
    told = words_of(header)
    assert "on test (512 frames of 5 motions" in told and "0.012 from the human" in told


def test_key_numbers_are_of_a_split_that_was_not_trained_on():
    tree = metrics()
    tree["splits"] = {"train": {"methods": {"s3le": method(0.001, 9)}}, **tree["splits"]}
    text = page_of(tree)
    header = text[: text.index("</header>")]
    assert "0.060" in header and "0.001" not in header
    assert 'id="results-1"' in text and words_of(text).count("Results on") == 4  # and contents


def test_page_compares_the_samplers():
    text = page_of(metrics())
    assert row_of(text, "uniform") == ["0.063", "0.060"]
    assert row_of(text, "pairs alone") == ["0.127", cells.NONE]


def test_page_says_what_was_not_measured():
    text = page_of(metrics())
    assert row_of(text, LABEL["lwl2_pairs"]) == ["not measured"] * 6
    assert row_of(text, LABEL["lwl2"])[-1] == "not measured"
    told = words_of(text)
    assert "Training: not measured." in told and "Times: not measured." in told
    assert told.count("Figure: not drawn.") == 5


def test_page_says_what_lies_between_the_frames():
    text, here = page_of(certified()), ">Between the frames</h2>"
    assert "not certified at 0.5 mm" in text
    assert row_of(text, "S3LE", here) == [
        "235", "235 (100 %)", "5.1 %", "0 %", "6.2 %", "50.2 %", "3.51"
    ]  # fmt: skip
    assert row_of(text, "S3LE + refine + certify", here)[:4] == ["235", "235 (100 %)", "0 %", "0 %"]
    assert row_of(text, LABEL["ale"], here)[:4] == ["235", "0 (0 %)", "-", "-"]  # no two safe poses
    told = words_of(text)
    assert "the straight path collides in 5.1 % of the segments" in told
    cost = row_of(text, "S3LE + certify", "What certifying cost</h3>")
    assert cost == ["20.0 %", "1.0 %", "0 %", "0.020", "0.031"]
    assert "must not happen" not in told


def test_page_names_the_certified_rows_by_what_proposes_their_poses():
    text = page_of(certified("skeleton"))
    assert row_of(text, "nearest skeleton + refine + certify")[4] == "131,008"
    assert "S3LE + refine" not in text


@pytest.mark.parametrize("what", ["segments_colliding", "segments_undecided", "segments_too_fast"])
def test_page_raises_the_alarm_when_a_certified_motion_does_not_hold(what):
    text = page_of(certified(**{what: 1}))
    assert '<p class="alarm">This must not happen: a certified motion' in text


def test_page_raises_the_alarm_when_a_certified_pose_is_unsafe():
    text = page_of(certified(limit_rate=0.5))
    assert "S3LE + certify (broken limits in 50.0 % of the frames)" in text


@pytest.mark.parametrize(
    ("rate", "what"),
    [
        ("collision_rate", "collisions"),
        ("below_margin_rate", "too little clearance"),
        ("limit_rate", "broken limits"),
    ],
)
def test_page_raises_the_alarm_when_a_checked_pose_is_unsafe(rate, what):
    broken = metrics()
    broken["splits"]["test"]["methods"]["ale"][rate] = 0.5  # ALE promises nothing
    assert "must not happen" not in page_of(broken)
    broken["splits"]["test"]["methods"]["s3le"][rate] = 0.00001
    text = page_of(broken)
    assert '<p class="alarm">This must not happen' in text
    assert f"S3LE ({what} in &lt; 0.1 % of the frames)" in text


def test_page_lists_the_pairs_that_are_not_watched():
    pair = ("DWYTorso", "LShr", "limb-trunk", "overlap at the anchor")
    assert row_of(page_of({}, unwatched=[pair]), "DWYTorso") == list(pair[1:])
    assert "The 1 pairs" not in page_of({})


def test_page_of_nothing_invents_nothing():
    text = page_of({})
    assert "Results: not measured." in text
    commands = text.index('id="compare"')
    rows = Reader(text).rows[: text[:commands].count("<tr>")]
    values = [cell for row in rows for cell in row[1:]]
    assert values and not any(letter.isdigit() for value in values for letter in value)
    assert " nan" not in text[:commands] and "None" not in text


@pytest.mark.parametrize(
    ("share", "words"),
    [(0.0, "0 %"), (1e-9, "< 0.1 %"), (0.031, "3.1 %"), (0.99999, "> 99.9 %"), (1.0, "100 %"),
     (None, "not measured"), (math.nan, "not measured")],
)  # fmt: skip
def test_only_an_exact_zero_reads_as_zero(share, words):
    assert cells.rate(share) == words
