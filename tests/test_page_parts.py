"""Parts of the page: times, parameters, pictures; nothing breaks out, and a browser shows it."""

import json
import math
import re

import browser
import numpy as np
import pytest
from paged import HOSTILE, ROOT, Reader, certified, latency, page_of, row_of, words_of
from PIL import Image
from ruamel.yaml import YAML

from s3le.errors import FilmError, ParameterError, TableError
from s3le.report import bars, curves, embed, parameters, records
from s3le.show import style, svg


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
