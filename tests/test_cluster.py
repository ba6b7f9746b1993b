"""The engine on a Ray cluster of this machine: same bytes, whatever dies."""

import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from toys import Toy
from worlds import coman

from s3le.errors import EngineError, RobotError
from s3le.robot.robot import Robot
from s3le.tuples.engine import key, run
from s3le.tuples.shards import TupleShards

pytest.importorskip("ray")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.wide,
    pytest.mark.filterwarnings("ignore"),  # Ray's own, of files and processes it leaves to the end
]
TESTS = Path(__file__).parent


@pytest.fixture(scope="module")
def cluster():
    """Two machines of one processor each, and a head that computes nothing."""
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    from ray.cluster_utils import Cluster

    before = os.environ.get("PYTHONPATH")
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [str(TESTS), before]))
    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
    made.machines = [made.add_node(num_cpus=1) for _ in range(2)]
    yield made
    made.shutdown()
    if before is None:
        del os.environ["PYTHONPATH"]
    else:
        os.environ["PYTHONPATH"] = before


def make(folder, toy, where, rows=95):
    told = []
    counts = run.produce(
        toy, rows, folder / "out", where, lambda *args: told.append(args), print, folder / "shelf"
    )
    return counts


def contents(folder):
    return {path.name: path.read_bytes() for path in (folder / "out").iterdir()}


def on(cluster):
    return run.Where(executor="ray", ray_address=cluster.address)


def test_a_cluster_makes_the_same_bytes_as_this_process(cluster, tmp_path):
    counts = make(tmp_path / "far", Toy(), on(cluster))
    assert counts == make(tmp_path / "near", Toy(), run.Where(workers=1))
    assert contents(tmp_path / "far") == contents(tmp_path / "near")


def test_a_refusal_of_the_task_arrives_as_it_was_raised(cluster, tmp_path):
    with pytest.raises(RobotError, match="shard 4 is refused"):
        make(tmp_path, Toy(refuses=4), on(cluster))


def test_a_worker_that_would_make_other_bytes_is_named(cluster, tmp_path, monkeypatch):
    real = key.fingerprint
    monkeypatch.setattr(
        run.key, "fingerprint", lambda *of: real(*of) | {"processor": "znver9 0123"}
    )
    with pytest.raises(EngineError, match="its processor is .*, the caller's is 'znver9 0123'"):
        make(tmp_path, Toy(), on(cluster))


def test_no_cluster_is_one_line(tmp_path):
    where = run.Where(executor="ray", ray_address="127.0.0.1:1")
    with pytest.raises(EngineError, match="no Ray cluster at ray_address '127.0.0.1:1'"):
        make(tmp_path, Toy(), where)


def test_a_machine_that_is_lost_in_mid_run_costs_no_row(cluster, tmp_path):
    """Real tuples; one of the two machines is unplugged as soon as the first shard is there."""
    coman().write(tmp_path / "robot")
    task = TupleShards(
        files=Robot.read(tmp_path / "robot").to_bytes(), seed=7, shard_rows=500,
        sampler="uniform", alpha=0.2, renormalise_mix=False,
    )  # fmt: skip

    def pull_the_plug():
        while not list((tmp_path / "far").rglob("00000*.parquet")):
            time.sleep(0.02)
        cluster.remove_node(cluster.machines.pop(), allow_graceful=False)

    plug = threading.Thread(target=pull_the_plug)
    plug.start()
    make(tmp_path / "far", task, on(cluster), rows=15_250)
    plug.join()
    assert len(cluster.machines) == 1
    make(tmp_path / "near", task, run.Where(workers=2), rows=15_250)
    assert contents(tmp_path / "far") == contents(tmp_path / "near")


def test_a_run_may_have_a_cluster_of_its_own(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(TESTS))
    make(tmp_path / "far", Toy(), run.Where(executor="ray", ray_address="local"))
    make(tmp_path / "near", Toy(), run.Where(workers=1))
    assert contents(tmp_path / "far") == contents(tmp_path / "near")


def test_without_ray_the_extra_is_named(tmp_path):
    (tmp_path / "ray.py").write_text("raise ImportError('none')")
    code = (
        "from pathlib import Path; from toys import Toy; from s3le.tuples.engine import run\n"
        "try:\n"
        "    run.produce(Toy(), 5, Path('out'), run.Where(executor='ray'), print, print)\n"
        "except Exception as error:\n"
        "    print(type(error).__name__, error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True,
        env=os.environ | {"PYTHONPATH": f"{tmp_path}:{TESTS}:{TESTS.parent}"},
    )  # fmt: skip
    assert done.stdout == (
        "EngineError executor 'ray' needs Ray; install it with: pip install .[cluster]\n"
    )
