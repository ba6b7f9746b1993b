"""The page: not a number invented, nothing that breaks out, and what a real browser makes of it."""

import json
import math
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import browser
import numpy as np
import pytest
from PIL import Image
from ruamel.yaml import YAML

from s3le.errors import FilmError, ParameterError, TableError
from s3le.report import bars, cells, curves, document, embed, parameters, records
from s3le.show import style, svg

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


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    """A picture of every kind, drawn small."""
    folder = tmp_path_factory.mktemp("pictures")
    rows = [
        {"split": "test", "clip": clip, "method": key, "to_truth": 0.02 * (1 + k), "frames": 30}
        for clip in ("walk", "<b>&|$x_")
        for k, (key, _) in enumerate(style.METHODS)
    ]
    bars.draw(folder / "bars.svg", rows, list(style.METHODS), "title <&>")
    history = [{"step": s, **{key: 1.0 / s + k for k, key in enumerate(curves.TERMS)}}
               for s in (50, 100, 150)]  # fmt: skip
    curves.draw(folder / "curves.svg", {"s3le": history, "lwl2": history})
    painted = np.random.default_rng(0).integers(0, 255, (200, 2400, 3)).astype(np.uint8)
    Image.fromarray(painted).save(folder / "strip.png")
    return folder, rows


# --- what it says


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


# --- times, parameters, video


def test_times_say_on_which_machine_and_whether_of_this_robot():
    tag = latency()["robot_tag"]
    own = page_of({}, latency=latency(), robot_tag=tag)
    assert row_of(own, "whole") == ["300", "410.0 µs", "1.02 ms", "6.90 ms"]
    assert "a machine" in own and "not of this run" not in own
    other = page_of({}, latency=latency(), robot_tag="jvrc 99 margin=0.002 neck=midpoint")
    told = "These times are not of this run: they were measured with another robot"
    assert f'<p class="alarm">{told}' in other
    margin = page_of({}, latency=latency(), robot_tag=tag.replace("0.002", "0.01"))
    assert "measured with this run's robot with another margin" in words_of(margin)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is not JSON"),
        ('{"format": 1', "is not JSON"),
        ("[" * 100_000, "is not JSON"),
        ("[]", "holds no JSON object"),
        ("{}", "format must be 1"),
        (json.dumps(latency(machine=3)), "'machine' must be text"),
        (json.dumps(latency(pairs=-1)), "'pairs' must be a count"),
        (json.dumps(latency(rows=[])), "'rows' must be a list"),
        (json.dumps(latency(rows=[{"part": "x", "calls": 1, "us_p50": 2, "us_p99": 1,
                                   "us_worst": 3}])), "that rise"),
        (json.dumps(latency(rows=[{"part": "x", "calls": 1, "us_p50": math.nan, "us_p99": 1,
                                   "us_worst": 3}])), "that rise"),
    ],
)  # fmt: skip
def test_a_damaged_record_of_times_is_refused_in_one_line(tmp_path, text, words):
    path = tmp_path / "latency.json"
    path.write_text(text)
    with pytest.raises(TableError, match=words) as refused:
        records.latency(path)
    assert str(path) in str(refused.value) and "online.py --record" in str(refused.value)


def test_the_record_in_the_repository_is_one():
    assert records.latency(ROOT / "reports" / "latency.json")["rows"]


def test_a_missing_record_says_how_to_write_it(tmp_path):
    with pytest.raises(TableError, match="is missing; write it with: python benchmarks/online.py"):
        records.latency(tmp_path / "no.json")


def test_every_parameter_is_shown_with_its_sentence():
    found = {one.key: one for one in parameters.read(ROOT / "params.yaml")}
    tree = YAML(typ="safe").load(ROOT / "params.yaml")
    flat = {
        f"{name}.{key}" if key else name: single
        for name, value in tree.items()
        for key, single in (value.items() if isinstance(value, dict) else [(None, value)])
    }
    assert found.keys() == flat.keys()
    assert all(one.sentence for one in found.values())
    assert found["alpha"].value == "0.2" and "Sec. IV-C" in found["alpha"].sentence
    assert found["export.check"].value == "true"
    assert found["sample.sampler"].sentence.endswith("uniform, quasi, arms, centred or rest")
    text = page_of({}, knobs=list(found.values()))
    assert row_of(text, "sample.rows")[0] == str(tree["sample"]["rows"])


@pytest.mark.parametrize(
    ("text", "words"),
    [("a: &x 1\nb: *x\n", "aliases"), ("- 1\n", "a mapping"), ("a: [", "as YAML"),
     ("a: 1 # " + "x" * 40_000, "longer than"), ("a: \xff", "as YAML")],
)  # fmt: skip
def test_odd_parameters_are_refused(tmp_path, text, words):
    path = tmp_path / "params.yaml"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(ParameterError, match=words):
        parameters.read(path)


def test_the_video_figure_is_shown_with_its_words_and_numbers(tmp_path, pictures):
    folder, _ = pictures
    told = {
        "title": "A <video>",
        "caption": "frames, skeletons, poses.",
        "numbers": {"frames": 4120, "to_human": 0.01234, "clips": ["a", "b"]},
        "fps": 29.97,
    }
    (tmp_path / "figure.json").write_text(json.dumps(told))
    text = page_of(
        {}, video=(records.figure(tmp_path / "figure.json"), embed.read(folder / "strip.png"))
    )
    assert "<h2>A &lt;video&gt;</h2>" in text and "<p>frames, skeletons, poses.</p>" in text
    assert row_of(text, "frames") == ["4,120"] and row_of(text, "to human") == ["0.0123"]
    video = ">A &lt;video&gt;</h2>"
    assert row_of(text, "clips", video) == ["a, b"] and row_of(text, "fps") == ["30"]
    assert 'id="video"' not in page_of({})
    for broken in ({"title": "t"}, {"title": "", "caption": "c"}, []):
        (tmp_path / "figure.json").write_text(json.dumps(broken))
        with pytest.raises(TableError, match="figure.json"):
            records.figure(tmp_path / "figure.json")


# --- what is put in


def test_text_is_escaped_by_construction():
    odd = '"<b>& *a* {{ 1 }} a\u202eb\ud800\x00'
    text = page_of({"run": {"clips": odd}}, figures={odd: embed.Media(b"", 1, 1, drawn=False)})
    shown = "&lt;b&gt;&amp; *a* {{ 1 }} a\ufffdb\ufffd\ufffd"
    assert f"<td>&#34;{shown}</td>" in text and f'alt="&#34;{shown}"' in text


def test_hostile_names_stay_words():
    tree = certified()
    tree["run"] |= {"robot": HOSTILE, "clips": HOSTILE}
    tree["splits"][HOSTILE] = tree["splits"].pop("test")
    tree["splits"][HOSTILE]["methods"][HOSTILE] = {}
    tree["clips"] = {HOSTILE: {"clips": 1}}
    tree["coverage"] = {HOSTILE: {HOSTILE: {"mean": 0.1}}}
    rows = [{"split": HOSTILE, "clip": HOSTILE, "method": "s3le", "to_truth": 0.1}]
    text = page_of(
        tree, {HOSTILE: [{"step": 1, HOSTILE: 1.0}]}, motions=rows, unwatched=[(HOSTILE,) * 4],
        knobs=[parameters.Parameter(HOSTILE, HOSTILE, HOSTILE)],
        latency=latency(machine=HOSTILE, settings={HOSTILE: 1}, modes={HOSTILE: 0.5}),
        robot_tag=HOSTILE,
    )  # fmt: skip
    text.encode("utf-8")
    seen = Reader(text)
    assert {"script", "img"}.isdisjoint(tag for tag, _ in seen.tags)
    assert not any(name.startswith("on") for _, attrs in seen.tags for name in attrs)
    assert "<img src=x onerror=alert(1)>" in seen.text and "\u202e" not in text


def test_a_picture_is_shrunk_and_a_drawing_keeps_its_letters_as_paths(pictures):
    folder, _ = pictures
    painted = embed.read(folder / "strip.png")
    assert (painted.width, painted.height) == (embed.WIDEST, 150)
    assert painted.content[8:12] == b"WEBP"
    drawn = embed.read(folder / "bars.svg")
    assert drawn.drawn and 500 < drawn.width < 700
    assert b"<text" not in drawn.content and b"<!--" not in drawn.content
    assert b"walk" not in drawn.content and b"date" not in drawn.content.lower()


@pytest.mark.parametrize("data", [b"", b"\x89PNG\r\n\x1a\n", b"GIF89a", "cut"])
def test_what_is_no_whole_png_is_refused(tmp_path, pictures, data):
    whole = (pictures[0] / "strip.png").read_bytes()
    path = tmp_path / "a.png"
    path.write_bytes(whole[: len(whole) // 2] if data == "cut" else data)
    with pytest.raises(FilmError, match="a.png is not a whole PNG"):
        embed.read(path)
    with pytest.raises(FilmError, match="no.png cannot be read"):
        embed.read(tmp_path / "no.png")


def test_a_drawing_is_the_same_bytes_twice_and_names_do_not_meet(tmp_path, pictures):
    folder, rows = pictures
    bars.draw(tmp_path / "again.svg", rows, list(style.METHODS), "title <&>")
    again = (tmp_path / "again.svg").read_text()
    assert again == (folder / "bars.svg").read_text()
    a, b = (svg.inline(again, name) for name in ("a", "b"))
    names = [set(re.findall(r' id="([^"]+)"', one)) for one in (a, b)]
    assert names[0] and not names[0] & names[1]
    assert set(re.findall(r'(?:href="#|url\(#)([^")]+)', a)) == names[0]


def light(colour: str) -> float:
    """Relative luminance of #rrggbb (WCAG 2)."""
    parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    parts = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
    return 0.2126 * parts[0] + 0.7152 * parts[1] + 0.0722 * parts[2]


def contrast(a: str, b: str) -> float:
    high, low = sorted((light(a), light(b)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def test_every_colour_of_a_chart_is_seen_on_dark_paper():
    paper = svg.DARK["#ffffff"]
    assert f"--paper: {paper}" in page_of({})
    used = {*style.COLOURS.values(), *style.SPARE, style.INK, style.QUIET, style.ALARM}
    used |= {colour for _, colour, _ in curves.TERMS.values()}
    for colour in used:
        assert contrast(svg.DARK.get(colour.lower(), colour), paper) >= 3.0, colour
    for letters in (style.INK, style.QUIET):
        assert contrast(svg.DARK[letters], paper) >= 4.5
    # The methods stay apart from each other.
    shown = [svg.DARK.get(c.lower(), c.lower()) for c in style.COLOURS.values()]
    assert len(set(shown)) == len(shown)


# --- in a browser

CONTRAST = """(() => {
  const lum = c => { const p = c.slice(0, 3).map(v => v / 255).map(
    v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
    return 0.2126 * p[0] + 0.7152 * p[1] + 0.0722 * p[2]; };
  const rgb = s => (s.match(/[0-9.]+/g) || []).map(Number);
  const under = e => { for (; e; e = e.parentElement) {
    const c = rgb(getComputedStyle(e).backgroundColor); if (c.length == 3 || c[3] == 1) return c; }
    return [255, 255, 255]; };
  let worst = [99, ''], seen = 0;
  const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walk.nextNode()) { const e = walk.currentNode.parentElement;
    if (!walk.currentNode.data.trim() || !e.checkVisibility()) continue;
    const a = lum(rgb(getComputedStyle(e).color)), b = lum(under(e)); seen++;
    const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    if (ratio < worst[0]) worst = [ratio, walk.currentNode.data.slice(0, 40)]; }
  return [worst[0], worst[1], seen]; })()"""


@pytest.mark.wide
@pytest.mark.skipif(not browser.PATH, reason="no Chromium on this machine")
def test_a_browser_opens_it_from_disk_in_light_and_dark_wide_and_narrow(tmp_path, pictures):
    folder, rows = pictures
    media = {name: embed.read(folder / file) for name, file in
             (("bars", "bars.svg"), ("curves", "curves.svg"), ("strip", "strip.png"))}  # fmt: skip
    text = page_of(
        certified(), {"s3le": [{"step": 50, "recon_x": 4.0}]}, media, motions=rows,
        unwatched=[("a" * 60, HOSTILE, "c", "d")], latency=latency(), robot_tag="another",
        knobs=parameters.read(ROOT / "params.yaml"),
        video=(records.Figure("t", "c", [("n", "1")]), media["strip"]),
    )  # fmt: skip
    (tmp_path / "report.html").write_text(text, encoding="utf-8")
    address = (tmp_path / "report.html").as_uri()
    shots, inks = {}, {}
    with browser.opened(tmp_path / "profile", 1280, 900) as view:
        for width in (1280, 390):
            view.call("Emulation.setDeviceMetricsOverride", width=width, height=900,
                      deviceScaleFactor=1, mobile=width < 500)  # fmt: skip
            for scheme in ("light", "dark"):
                view.call("Emulation.setEmulatedMedia", media="screen",
                          features=[{"name": "prefers-color-scheme", "value": scheme}])  # fmt: skip
                view.call("Page.navigate", url=address)
                view.wait("document.readyState == 'complete' && document.images.length == 2")
                view.run("document.querySelectorAll('details').forEach(d => d.open = true)")
                assert view.run("[...document.images].every(i => i.complete && i.naturalWidth)")
                assert view.run("document.documentElement.scrollWidth") <= width
                ratio, where, seen = view.run(CONTRAST)
                assert seen > 300 and ratio >= 4.5, (scheme, where)
                inks[scheme] = view.run(
                    "[...document.querySelectorAll('.drawn svg g path')].map("
                    "p => getComputedStyle(p).fill).join()"
                )
                shots[width, scheme] = view.screenshot(x=0, y=0, width=width, height=900)
                ids = "[...document.querySelectorAll('[id]')].map(e => e.id)"
                assert view.run(f"(i => new Set(i).size == i.length)({ids})")
                links = "[...document.querySelectorAll('nav a')]"
                assert view.run(f"{links}.length") == 13
                assert view.run(f"{links}.every(a => document.querySelector(a.hash))")
        view.call("Emulation.setDeviceMetricsOverride", width=720, height=1000,
                  deviceScaleFactor=1, mobile=False)  # fmt: skip
        view.call("Emulation.setEmulatedMedia", media="print",
                  features=[{"name": "prefers-color-scheme", "value": "dark"}])  # fmt: skip
        assert view.run("document.documentElement.scrollWidth") <= 720  # nothing is cut on paper
        assert ground(view.screenshot(x=0, y=0, width=720, height=1000)) == 255
    assert view.wrong == []
    assert view.asked and all(url == address or url.startswith("data:") for url in view.asked)
    assert inks["light"] != inks["dark"]  # the charts are recoloured
    for width in (1280, 390):
        grounds = [ground(shots[width, scheme]) for scheme in ("light", "dark")]
        assert grounds[0] > 230 and grounds[1] < 50


def ground(shot: bytes) -> float:
    """Brightness of most of a picture."""
    from io import BytesIO

    with Image.open(BytesIO(shot)) as image:
        return float(np.median(np.array(image.convert("L"))))


# --- dvc lays two runs over each other


def test_dvc_plots_diff_shows_every_chart_of_two_runs(tmp_path):
    """The project's own plots on the project's own files, which differ between two commits."""
    plots = YAML(typ="safe").load(ROOT / "dvc.yaml")["plots"]
    YAML().dump({"plots": plots}, tmp_path / "dvc.yaml")
    files = named(plots)

    def good(*command: str) -> tuple[str, str]:
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout, done.stderr

    for file in files:
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_bytes((ROOT / file).read_bytes())
    git = ("git", "-c", "user.name=t", "-c", "user.email=t@t", "-c", "commit.gpgsign=false")
    good("git", "init", "-q")
    dvc = str(Path(sys.executable).with_name("dvc"))
    good(dvc, "init", "-q")
    good("git", "add", "-A")
    good(*git, "commit", "-qm", "one")
    for file in files:
        if file.endswith(".csv"):
            lines = (tmp_path / file).read_text().splitlines()
            (tmp_path / file).write_text("\n".join(lines[:-1]) + "\n")
    good("git", "add", "-A")
    good(*git, "commit", "-qm", "two")
    shown, warned = good(dvc, "plots", "diff", "HEAD~1", "HEAD", "--json")
    assert "WARNING" not in warned and "failed" not in warned
    found = json.loads(shown)["data"]
    assert found.keys() == {p if isinstance(p, str) else next(iter(p)) for p in plots}
    for name, versions in found.items():
        if versions[0]["type"] == "vega":
            revisions = {row["rev"] for row in versions[0]["content"]["data"]["values"]}
            assert len(revisions) == 2, name
        else:
            assert len(versions) == 2, name


def named(plots) -> set[str]:
    """Files that the plots are of."""
    found = set()
    for plot in plots:
        if isinstance(plot, str):
            found.add(plot)
            continue
        for how in plot.values():
            for axis in ("x", "y"):
                found |= set(how[axis]) if isinstance(how[axis], dict) else set()
    return found
