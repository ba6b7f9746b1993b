"""Bodies and strips are drawn as they stand, and names of any script are printed."""

from pathlib import Path

import numpy as np
import pytest
from drawn import METHODS, size_of, twice

from s3le.errors import ParameterError
from s3le.report import bars, growth
from s3le.robot import model
from s3le.robot.certificate import placements
from s3le.show import camera, figures, human, raster, strip, style

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def coman():
    """Skeletons (3, 21), capsule ends (3, b, 2, 3), radii, who stands still; not compiled."""
    robot = model.load(ROOT / "s3le/robots/coman.yaml")
    rng = np.random.default_rng(3)
    q = np.stack([robot.anchor, np.zeros(robot.n_dof), rng.uniform(robot.lower, robot.upper)])
    half = [np.linalg.norm(body.b - body.a) / 2 for body in robot.bodies]
    ends = np.array(
        [
            [
                [at.getTranslation() + side * h * at.getRotation()[:, 2] for side in (-1, 1)]
                for at, h in zip(placements(robot, pose), half, strict=True)
            ]
            for pose in q
        ]
    )
    up, left = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
    t_pose = np.concatenate([up, *[-left] * 3, *[left] * 3])
    hanging = np.concatenate([up, -left, *[-up] * 2, left, *[-up] * 2])
    still = np.array([body.joint == -1 for body in robot.bodies])
    radius = np.array([body.radius for body in robot.bodies])
    return np.stack([t_pose, hanging, t_pose]), ends, radius, still


# --- bodies


def test_camera_is_a_rotation_and_sees_the_front_from_its_left_and_above():
    turn = camera.camera()
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1.0)
    x, y, z = turn.T  # where forward, left and up point in the picture
    assert x[2] > 0.8 and y[0] > 0.8 and z[1] > 0.8  # to the viewer, to the right, up
    assert y[2] > 0 and z[2] > 0  # its left side and its top are turned towards the viewer


def test_ray_hits_a_capsule_where_the_nearest_of_many_balls_is():
    rng = np.random.default_rng(1)
    for _ in range(20):
        a, b = rng.normal(0, 0.3, (2, 3))
        r = rng.uniform(0.05, 0.2)
        u, v = np.linspace(-0.7, 0.7, 23), np.linspace(0.7, -0.7, 19)
        depth, body = np.full((19, 23), -np.inf), np.full((19, 23), -1, np.int32)
        raster._cast(np.array([[a, b]]), np.array([r]), u, v, depth, body)
        centres = a + np.linspace(0, 1, 2001)[:, None] * (b - a)
        gap = (
            r**2 - (u[None, :, None] - centres[:, 0]) ** 2 - (v[:, None, None] - centres[:, 1]) ** 2
        )
        slow = np.where(gap >= 0, centres[:, 2] + np.sqrt(np.maximum(gap, 0)), -np.inf).max(axis=2)
        both = np.isfinite(depth) & np.isfinite(slow)
        assert (np.isfinite(depth) == np.isfinite(slow)).mean() > 0.99  # rims may differ
        assert (np.isfinite(depth) == (body == 0)).all()
        # [m] the row of balls is a little inside the capsule, most where a ray grazes it
        assert np.all(depth[both] >= slow[both] - 1e-9)
        assert np.median(np.append(depth[both] - slow[both], 0.0)) < 1e-4


def test_nearer_body_hides_the_farther_one():
    towards = camera.camera()[2]
    ends = np.array([[towards * 0.5] * 2, [towards * -0.5] * 2])
    red, green = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
    for order in (slice(None), slice(None, None, -1)):
        colours = np.array([red, green])[order]
        picture = camera.render(
            ends[order], np.array([0.2, 0.2]), colours, (-0.3, 0.3), 100, (60, 60)
        )
        centre = picture[30, 30].astype(int)
        assert centre[0] > centre[1] + 50
        assert picture[0, 0].tolist() == [255, 255, 255]


def test_body_outside_the_picture_is_left_out():
    far = np.full((1, 2, 3), 50.0)
    one = np.array([0.1]), np.array([[1.0, 0, 0]])
    picture = camera.render(far, *one, (0.0, 0.0), 50, (20, 30))
    assert picture.shape == (20, 30, 3) and (picture == 255).all()


def ball(fine=1, at=((0.0, 0.0, 0.0),), radius=0.2, size=80):
    """Colour and cover (size, size) of grey balls; the first is in the middle."""
    ends = np.repeat(np.array(at)[:, None], 2, 1)
    how = np.full((len(ends), 3), 0.5), (-0.4, 0.4), size / 0.8, (size, size), fine
    colour, cover = raster.rays(ends, np.full(len(ends), radius), *how)
    return colour[..., 0], cover[..., 0]


def test_a_ball_is_lit_from_above_and_the_left_and_has_a_dark_rim():
    colour, cover = ball()
    x = (np.arange(80) + 0.5) / 100 - 0.4
    away = np.hypot(x[None], x[:, None])
    assert ((cover == 1) == (away < 0.2)).all() and (colour[cover == 0] == 0).all()
    inside = np.where(away < 0.17, colour, 0.0)
    row, column = np.unravel_index(inside.argmax(), inside.shape)
    brightest = np.array([x[column], -x[row]])  # rows count from the top
    light = np.array([-0.50, 0.72])
    turned = brightest @ light / np.linalg.norm(brightest) / np.linalg.norm(light)
    assert turned > 0.98 and 0.06 < np.linalg.norm(brightest) < 0.15
    rim = (away > 0.19) & (away < 0.2)
    assert colour[rim].mean() < 0.3 * colour[40, 40]


def test_finer_rays_soften_the_edge_and_keep_the_area():
    (_, plain), (_, fine) = ball(1), ball(4)
    area = np.pi * 0.2**2 * 100**2  # [pixels]
    assert set(np.unique(plain)) == {0.0, 1.0} and len(np.unique(np.round(fine * 16))) > 8
    assert abs(fine.sum() - area) < 0.003 * area and abs(plain.sum() - area) < 0.02 * area


def test_a_crevice_is_darker_than_the_same_place_without_the_nearer_neighbour():
    alone, _ = ball()
    both, _ = ball(at=((0.0, 0.0, 0.0), (0.25, 0.0, 0.3)))
    beside = np.s_[35:45, 41:44]  # between the middle and the nearer ball's rim
    assert (both[beside] < 0.95 * alone[beside]).all()
    assert both[40, 25] == pytest.approx(alone[40, 25], abs=0.02)


def test_a_shadow_lies_below_a_body_and_fades_with_its_height():
    view = camera.camera()
    at = np.array([[[0.0, 0.0, 0.1]] * 2])
    u, v = np.linspace(-1, 1, 81), np.linspace(1, -1, 81)

    def lost(height):
        return raster.shadow(at + [0, 0, height], np.array([0.1]), 0.0, u, v, view)

    resting, above, far = lost(0.0), lost(0.1), lost(1.0)
    row, column = np.unravel_index(resting.argmax(), resting.shape)
    assert abs(u[column]) < 0.1 and abs(v[row]) < 0.1  # where the floor below it is seen
    assert resting.max() == pytest.approx(0.34) and 0.1 < above.max() < 0.2 and far.max() == 0.0
    assert resting[0, 0] == resting[-1, -1] == 0.0


# --- strip


def test_stick_figure_follows_the_skeleton(coman):
    x = coman[0][0]
    (ends,), radius, colours = human.stick_figures(x[None])
    assert len(ends) == len(radius) == len(colours)
    trunk, *_ = (e for e, c in zip(ends, colours, strict=True) if c == human.MIDDLE)
    np.testing.assert_allclose(trunk[1] - trunk[0], human.TRUNK * x[:3], atol=1e-12)
    left = [e for e, c in zip(ends, colours, strict=True) if c == human.LEFT]
    np.testing.assert_allclose(left[2][1] - left[2][0], human.FOREARM * x[18:], atol=1e-12)
    assert left[2][1][1] > 0.5  # [m] in the T-pose the left hand is far to the left


def test_strip_of_human_and_robots(tmp_path, coman):
    x, ends, radius = coman[0][1:], coman[1][1:], coman[2]
    marked = np.array([False, True])
    rows = [
        strip.Row("human", skeleton=x),
        strip.Row("ground truth", ends=ends, radius=radius, colour=style.colour("truth")),
        strip.Row("ALE", ends=ends, radius=radius, marked=marked, note=["a", "b"]),
    ]
    width, height = twice(
        tmp_path, lambda path: strip.draw(path, np.array([0.0, 0.5]), rows, "two poses")
    )
    assert 700 < width < 2200 and 700 < height < 2200


def test_a_collision_is_seen_in_the_picture(tmp_path, coman):
    row = strip.Row("ALE", ends=coman[1][:1], radius=coman[2])
    for hit in (False, True):
        rows = [row._replace(marked=np.array([hit]))]
        strip.draw(tmp_path / f"{hit}.png", np.zeros(1), rows, "t")
    assert (tmp_path / "True.png").read_bytes() != (tmp_path / "False.png").read_bytes()


def test_bodies_that_never_move_are_the_ones_that_stand_still(coman):
    _, ends, radius, still = coman
    row = strip.Row("robot", ends=ends, radius=radius)
    np.testing.assert_array_equal(figures.still(row), still)
    assert not figures.still(row._replace(ends=ends[:1])).any()  # one pose does not tell
    np.testing.assert_array_equal(figures.still(row._replace(ends=ends[:1], still=still)), still)


@pytest.mark.parametrize("spaces", [("s3le", "skeleton"), ("skeleton",), ()])
def test_growth_is_the_same_picture_twice(tmp_path, spaces):
    rows = [
        {"space": space, "search": search, "rows": n, "us_p50": n * slope + 9.0, "us_p99": n * 1.0}
        for space in spaces
        for search, slope in (("exact", 0.01), ("walk", 1e-5))
        for n in (1_000_000, 10_000)
    ]
    assert twice(tmp_path, lambda path: growth.draw(path, rows, "a note")) == (1140, 690)


@pytest.mark.parametrize(
    ("us", "words"),
    [(7.23, "7.2 µs"), (99.7, "100 µs"), (999.6, "1 ms"), (12_345.0, "12 ms"), (2e6, "2 s")],
)
def test_a_time_has_the_unit_that_fits(us, words):
    assert growth.time_of(us) == words


def test_photos_stand_above_the_figures_with_what_was_seen_in_them(tmp_path):
    x = np.tile([[0, 0, 1, 0, -1, 0, 0, 0, -1, 0, 0, -1, 0, 1, 0, 0, 0, -1, 0, 0, -1]], (2, 1))
    rows = [strip.Row("human", skeleton=x.astype(float))]
    blue = [np.full((40, 30, 3), (20, 60, 200), np.uint8)] * 2
    lines = np.array([[[[5.0, 5.0], [25.0, 35.0]]]] * 2)
    photos = strip.Photos("video", blue, lines, ["#ff0000"])
    strip.draw(tmp_path / "with.png", np.arange(2.0), rows, "t", photos=photos)
    strip.draw(tmp_path / "without.png", np.arange(2.0), rows, "t")
    seen, bare = (plt_image(tmp_path / f"{name}.png") for name in ("with", "without"))
    assert seen.shape[0] > bare.shape[0] + 100 and seen.shape[1] == bare.shape[1]
    for colour in ((20, 60, 200), (255, 0, 0)):
        assert (np.abs(seen - colour).max(axis=2) < 3).any(), colour
    with pytest.raises(ParameterError, match="2 photos for 1 moments"):
        strip.draw(tmp_path / "a.png", np.zeros(1), [], "t", photos=photos)


def plt_image(path):
    from matplotlib.image import imread

    return np.round(imread(path)[..., :3] * 255).astype(int)


def test_strip_takes_one_moment_a_missing_pose_and_nothing(tmp_path, coman):
    x, ends, radius, still = coman
    lost = ends[:1].copy()
    lost[0, 4] = np.nan
    rows = [
        strip.Row("human", skeleton=x[:1]),
        strip.Row("found", ends=ends[:1], radius=radius, still=still),
        strip.Row("lost", ends=lost, radius=radius),
    ]
    times = np.array([2.0])
    nobody = strip.Row("human", skeleton=np.full((1, 21), np.nan))
    path = tmp_path / "a.png"
    for some in (rows, rows[2:], [nobody], []):
        strip.draw(path, times, some, "a title that is rather long " * 5)
        assert min(size_of(path)) > 200
    empty = strip.Row("human", skeleton=np.zeros((0, 21)))
    strip.draw(path, np.zeros(0), [empty], "t")
    assert min(size_of(path)) > 200


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({}, "strip row 'bad' needs either a skeleton or capsule ends"),
        ({"skeleton": np.zeros((1, 21)), "ends": np.zeros((1, 2, 2, 3))}, "either"),
        ({"skeleton": np.zeros((2, 21))}, r"must have shape \(1, 21\), got \(2, 21\)"),
        ({"ends": np.zeros((1, 2, 2, 3)), "radius": np.ones(3)}, r"got \(1, 2, 2, 3\) and \(3,\)"),
        ({"ends": np.zeros((1, 2, 2, 3))}, r"radius \(b,\)"),
        ({"skeleton": np.zeros((1, 21)), "marked": np.zeros(2, bool)}, "marked must have 1"),
        ({"skeleton": np.zeros((1, 21)), "note": []}, "note must have 1 entries, got 0"),
    ],
)
def test_a_row_that_does_not_fit_is_refused_by_name(tmp_path, fields, message):
    with pytest.raises(ParameterError, match=message):
        strip.draw(tmp_path / "a.png", np.array([0.0]), [strip.Row("bad", **fields)], "t")
    assert not list(tmp_path.iterdir())


# --- names


NAME = "춤_ダンス_舞踊_танец_" + "z" * 60 + "_👋"  # Cyrillic is in the font


def written(monkeypatch) -> list[str]:
    """What figures say from now on."""
    from matplotlib.text import Text

    said = []
    draw = Text.draw
    monkeypatch.setattr(
        Text, "draw", lambda self, *a, **k: (said.append(self.get_text()), draw(self, *a, **k))[1]
    )
    return said


def test_letters_that_the_font_lacks_are_printed_in_latin():
    assert style.printable("Ünter den Łinden, Ωμέγα, танец\nзима") == (
        "Ünter den Łinden, Ωμέγα, танец\nзима"
    )
    latin = style.printable("左腕 ダンス 춤")
    assert latin.isascii() and "dansu" in latin.lower() and "chum" in latin.lower()
    assert style.printable("a\u0308") == "ä" and style.printable("\ue000") == "?"
    for width in (0.1, 1.0, 3.0):
        lines = style.wrapped(NAME, width, 9.0, bold=True).split("\n")
        assert "".join(lines) == style.printable(NAME)
        assert all(style.wide(one, 9.0, bold=True) <= width or len(one) == 1 for one in lines)
    assert style.wrapped("two words", 0.4, 9.0) == "two\nwords"


def test_a_figure_drawn_before_does_not_change_how_wide_words_are():
    style._advance.cache_clear()
    before = style.wide("two words", 9.0)
    style._advance.cache_clear()
    style.wide("t", 9.0)
    small = style.figure(2.0, 1.0)
    small.text(0.5, 0.5, "other", size=5)
    small.canvas.draw()
    assert style.wide("two words", 9.0) == before


# A glyph that is missing is a warning, and a warning an error here.
@pytest.mark.parametrize("name", [NAME, "舞" * 30], ids=["mixed", "Chinese"])
def test_figures_print_names_of_any_script_and_do_not_cut_them(tmp_path, coman, monkeypatch, name):
    from s3le.show import film

    x, ends, radius, _ = coman
    said = written(monkeypatch)
    rows = [strip.Row(f"human: {name}", skeleton=x), strip.Row(name, ends=ends, radius=radius)]
    strip.draw(tmp_path / "a.png", np.arange(len(x)) / 10, rows, name)
    whole = style.printable(name)

    def anywhere():
        return any(whole in "".join(one.split("\n")) for one in said)

    assert anywhere()
    for suffix in ("png", "svg"):
        said.clear()
        row = {"split": "test", "clip": name, "method": "s3le", "to_truth": 0.1}
        bars.draw(tmp_path / f"b.{suffix}", [row], METHODS, name)
        assert anywhere()
    said.clear()
    with style.sheet():
        made = film.Film(
            np.arange(len(x)) / 10, rows, [], [(name, "#ff0000")], camera.USUAL, 640, 1
        )
        assert made.picture(0).shape == (*made.size[::-1], 3)
    assert anywhere()
