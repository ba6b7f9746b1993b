"""Figures of the report are drawn the same twice, whatever the rows: style, bars, curves, maps."""

import math

import matplotlib
import numpy as np
import pytest
from drawn import METHODS, rows_of, size_of, twice

from s3le.errors import ParameterError
from s3le.report import bars, curves, maps, spaces
from s3le.show import style
from s3le.store import atomic

# --- style


def test_every_method_has_one_colour_of_its_own():
    keys = [key for key, _ in METHODS] + ["truth"]
    assert len({style.colour(key) for key in keys}) == len(keys)


def test_drawing_leaves_the_settings_of_others_alone(tmp_path):
    before = dict(matplotlib.rcParams)
    curves.draw(tmp_path / "a.png", {})
    assert dict(matplotlib.rcParams) == before


def test_a_users_settings_do_not_change_the_picture(tmp_path):
    rows = rows_of("test", 1)
    bars.draw(tmp_path / "a.png", rows, METHODS, "t")
    with matplotlib.rc_context({"font.size": 20, "axes.facecolor": "red", "savefig.dpi": 30}):
        bars.draw(tmp_path / "b.png", rows, METHODS, "t")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_a_failed_save_leaves_the_old_picture_and_no_scrap(tmp_path, monkeypatch):
    path = tmp_path / "a.png"
    path.write_bytes(b"old")

    def refuse(*_):
        raise OSError("disk full")

    monkeypatch.setattr(atomic.os, "replace", refuse)
    with pytest.raises(OSError, match="disk full"):
        curves.draw(path, {})
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.png"]


# --- bars


@pytest.mark.parametrize(
    ("n", "widest"), [(1, 1300), (5, 1300), pytest.param(44, 2400, marks=pytest.mark.wide)]
)
def test_bars_grow_with_the_motions_and_stay_printable(tmp_path, n, widest):
    width, height = twice(
        tmp_path, lambda path: bars.draw(path, rows_of("test", n), METHODS, "COMAN")
    )
    assert 1000 < width <= widest
    assert 300 < height < 2400


def test_bars_show_a_missing_value_as_missing(tmp_path):
    rows = rows_of("test", 2)
    bars.draw(tmp_path / "whole.png", rows, METHODS, "t")
    for bad in (None, math.nan):
        rows[3]["to_truth"] = bad
        bars.draw(tmp_path / f"{bad}.png", rows, METHODS, "t")
    assert (tmp_path / "None.png").read_bytes() == (tmp_path / "nan.png").read_bytes()
    assert (tmp_path / "None.png").read_bytes() != (tmp_path / "whole.png").read_bytes()


@pytest.mark.parametrize(
    ("rows", "methods"),
    [
        ([], METHODS),
        (rows_of("test", 2), []),
        (rows_of("test", 1) + rows_of("held $out_", 3), [("new", "a $new_ method"), *METHODS[:1]]),
        ([{"split": "test", "clip": "x" * 90, "method": "s3le", "to_truth": 0.0}], METHODS),
    ],
    ids=["no motions", "no methods", "unknown method", "long name, perfect, frames unknown"],
)
def test_bars_take_odd_input(tmp_path, rows, methods):
    bars.draw(tmp_path / "a.png", rows, methods, "t")
    assert min(size_of(tmp_path / "a.png")) > 200


# --- curves


def test_curves_draw_a_panel_for_each_method(tmp_path):
    rng = np.random.default_rng(0)
    history = [
        {"step": step, "recon_x": 4 * math.exp(-step / 300), "prior_x": rng.normal(0, 0.01)}
        for step in range(50, 1001, 50)
    ]
    one, _ = twice(tmp_path, lambda path: curves.draw(path, {"s3le": history}))
    three, _ = twice(
        tmp_path, lambda path: curves.draw(path, dict.fromkeys(("ale", "lwl2", "s3le"), history))
    )
    assert three > 2 * one


@pytest.mark.parametrize(
    "histories",
    [
        {},
        {"s3le": []},
        {"s3le": [{"step": 50, "recon_x": 1.0}]},
        {"s3le": [{"step": 50, "recon_x": math.nan}, {"step": 100}]},
        {"mine": [{"step": s, "odd_term": float(s), "zero": 0.0} for s in (1, 10, 100)]},
    ],
    ids=["none", "empty", "one row", "nothing finite", "unknown names"],
)
def test_curves_take_odd_input(tmp_path, histories):
    curves.draw(tmp_path / "a.png", histories)
    assert min(size_of(tmp_path / "a.png")) > 200


# --- maps


def points_of(side: int, noise: float = 0.0) -> dict[str, np.ndarray]:
    """Columns of table synthetic: a grid and three glue points, for both variants."""
    at = np.linspace(0, 2, side)
    grid = np.stack(np.meshgrid(at, at, indexing="ij"), axis=-1).reshape(-1, 2)
    x = np.concatenate((grid, [[0.2, 0.3], [0.7, 0.1], [0.5, 0.9]]))
    rng = np.random.default_rng(4)
    answer = np.clip(np.minimum(x, 1) + noise * rng.normal(size=x.shape), 0, 1)
    one = {
        "row": np.arange(len(x)), "kind": np.array(["grid"] * side**2 + ["glue"] * 3, object),
        "x": x, "x_true": np.minimum(x, 1), "y_true": 2 * np.minimum(x, 1),
        "x_answer": answer, "y_answer": 2 * answer,
    }  # fmt: skip
    both = {name: np.concatenate((values, values)) for name, values in one.items()}
    return both | {"nt_xent": np.repeat([False, True], len(x))}


def latent_space(n_motions=3, m=12):
    rng = np.random.default_rng(0)
    human = rng.normal(size=(m, 2))
    return spaces.Space(
        "s3le", rng.normal(size=(50, 2)), human, human + 0.1, np.arange(m) % n_motions,
        [f"m{k}" for k in range(n_motions)], 5.5, 0.25,
    )  # fmt: skip


@pytest.mark.parametrize("panels", [[3], [3, 3, 3], [20], []])
def test_latent_spaces_draw_a_panel_each(tmp_path, panels):
    made = [latent_space(k, 40) for k in panels]
    width, _ = twice(tmp_path, lambda path: spaces.draw(path, made))
    assert width == round(3.3 * max(len(panels), 1) * style.DPI)


def errors() -> dict:
    """Figures of the synthetic example."""
    keys = ("error_all", "error_invariant", "error_feasible")
    without, with_it = (
        {key: {"mean": mean, "sd": 0.0123} for key, mean in zip(keys, means, strict=True)}
        for means in ((0.0811, 0.0911, 0.0211), (0.0611, 0.0711, 0.0311))
    )
    return {"without_nt_xent": without, "with_nt_xent": with_it, "seeds": 5, "better": 4,
            "shown": 2}  # fmt: skip


@pytest.mark.parametrize("side", [3, 5, 41])
def test_maps_draw_any_grid(tmp_path, side):
    width, height = twice(tmp_path, lambda path: maps.draw(path, points_of(side, 0.05), errors()))
    assert 1300 < width < 2000 and 900 < height < 1500


def test_maps_take_no_points_one_variant_and_no_figures(tmp_path):
    points = points_of(5)
    for some in (points["nt_xent"], np.zeros(len(points["x"]), bool)):
        maps.draw(tmp_path / "a.png", {name: v[some] for name, v in points.items()}, {})
        assert min(size_of(tmp_path / "a.png")) > 200


def test_maps_refuse_what_is_no_grid(tmp_path):
    points = points_of(5)
    for order in (slice(1, None), slice(None, None, -1)):
        with pytest.raises(ParameterError, match="no square grid"):
            maps.draw(tmp_path / "a.png", {name: v[order] for name, v in points.items()}, {})
    assert not list(tmp_path.iterdir())


def test_colours_of_correspondence_tell_points_apart():
    at = np.linspace(0, 1, 6)
    tint = maps.colours(np.stack(np.meshgrid(at, at, indexing="ij"), -1)).reshape(-1, 3)
    assert np.all((tint >= 0) & (tint <= 1))
    apart = np.linalg.norm(tint[:, None] - tint[None], axis=-1)[~np.eye(36, dtype=bool)]
    assert apart.min() > 0.03
    corners = [[int(c[i : i + 2], 16) / 255 for i in (1, 3, 5)] for c in maps.CORNERS]
    ends = np.array([[0, 0], [1, 0], [0, 1], [1, 1]], float)
    np.testing.assert_allclose(maps.colours(ends), corners, atol=1e-12)
