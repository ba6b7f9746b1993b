"""Libraries for the nearest stored pose of a human frame: time, memory and recall side by side.

    python benchmarks/retrieval.py [--rows 100000,1000000] [--spaces s3le,skeleton]
        [--clips FOLDER] [--libraries walk,exact,hnswlib,faiss,ivf,flat,usearch,kdtree]

Queries are people, encoded: they lie off what is stored. A found distance within 1 % of the true
one counts as found; recall@8 is the share of the eight nearest rows. Times are processor time of
one thread, one query a call from Python, eight rows wanted. hnswlib, faiss-cpu, usearch and scipy
are no dependencies of the project; those not installed are left out. Nothing is asserted.
"""

import importlib.util
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import typer
from stored import SPACES, World, timed, true_distances, worlds

from s3le.kernels.threads import use_threads
from s3le.search import neighbours

K = 8  # rows wanted
NEAR = 1.01


class Made(NamedTuple):
    """One built index with one setting of its search."""

    label: str
    search: Callable  # one query -> rows, nearest first
    build: float  # [s], processor time
    size: int  # [bytes]
    load: float  # [s]
    share: int = 1  # of the queries only every so many are asked


def walk(z: np.ndarray, folder: Path) -> Iterator[Made]:
    """This project's own, s3le/search/neighbours.py."""
    neighbours.build(z[:200])  # compiles
    index, build = spent(lambda: neighbours.build(z))
    index.save(folder / "walk")
    index, load = spent(lambda: neighbours.load(folder / "walk"))
    size = (folder / "walk").stat().st_size
    for width in (16, 32, 48, 64, 96, 128):
        seek = index.seeker(K, width)
        yield Made(f"walk, width {width}", lambda q, s=seek: s(q)[0], build, size, load)


def exact(z: np.ndarray, folder: Path) -> Iterator[Made]:
    """This project's own, looking at all."""
    seek = neighbours.build(z, exact=True).seeker(K)
    yield Made("exact, all rows", lambda q: seek(q)[0], 0.0, z.nbytes, 0.0, 8)


def hnswlib(z: np.ndarray, folder: Path) -> Iterator[Made]:
    """hnswlib: 16 links a row and 32 on the lowest layer."""
    import hnswlib as library

    def make() -> object:
        index = library.Index(space="l2", dim=z.shape[1])
        index.init_index(max_elements=len(z), ef_construction=100, M=16, random_seed=1)
        index.add_items(z, num_threads=1)
        return index

    index, build = spent(make)
    path = folder / "hnswlib"
    index.save_index(str(path))
    index = library.Index(space="l2", dim=z.shape[1])
    _, load = spent(lambda: index.load_index(str(path), max_elements=len(z)))
    for width in (16, 32, 48, 64, 96, 128):

        def search(q: np.ndarray, width: int = width) -> np.ndarray:
            return index.knn_query(q, k=K, num_threads=1)[0][0]

        index.set_ef(width)
        yield Made(f"hnswlib, ef {width}", search, build, path.stat().st_size, load)


def faiss(z: np.ndarray, folder: Path) -> Iterator[Made]:
    """Faiss' HNSW over whole vectors, the same size."""
    import faiss as library

    library.omp_set_num_threads(1)

    def make() -> object:
        index = library.IndexHNSWFlat(z.shape[1], 16)
        index.hnsw.efConstruction = 100
        index.add(z)
        return index

    index, build = spent(make)
    path = folder / "faiss"
    library.write_index(index, str(path))
    index, load = spent(lambda: library.read_index(str(path)))
    for width in (16, 32, 48, 64, 96, 128):
        index.hnsw.efSearch = width
        yield Made(
            f"faiss HNSW, ef {width}", lambda q: index.search(q[None], K)[1][0],
            build, path.stat().st_size, load,
        )  # fmt: skip


def ivf(z: np.ndarray, folder: Path) -> Iterator[Made]:
    """Faiss' inverted lists, 4 sqrt(n) of them."""
    import faiss as library

    library.omp_set_num_threads(1)
    lists = int(4 * np.sqrt(len(z)))
    some = np.random.default_rng(0).choice(len(z), min(len(z), 40 * lists), replace=False)

    def make() -> object:
        index = library.IndexIVFFlat(library.IndexFlatL2(z.shape[1]), z.shape[1], lists)
        index.train(z[some])
        index.add(z)
        return index

    index, build = spent(make)
    path = folder / "ivf"
    library.write_index(index, str(path))
    index, load = spent(lambda: library.read_index(str(path)))
    for probes in (8, 16, 32, 64, 128):
        index.nprobe = probes
        yield Made(
            f"faiss IVF {lists}, nprobe {probes}", lambda q: index.search(q[None], K)[1][0],
            build, path.stat().st_size, load,
        )  # fmt: skip


def flat(z: np.ndarray, folder: Path) -> Iterator[Made]:
    """faiss, looking at all."""
    import faiss as library

    library.omp_set_num_threads(1)
    index = library.IndexFlatL2(z.shape[1])
    index.add(z)
    yield Made("faiss flat", lambda q: index.search(q[None], K)[1][0], 0.0, z.nbytes, 0.0, 4)


def usearch(z: np.ndarray, folder: Path) -> Iterator[Made]:
    """Usearch."""
    from usearch.index import Index

    def make() -> object:
        index = Index(ndim=z.shape[1], metric="l2sq", dtype="f32", connectivity=16,
                      expansion_add=100, expansion_search=64)  # fmt: skip
        index.add(np.arange(len(z)), z, threads=1)
        return index

    index, build = spent(make)
    path = folder / "usearch"
    index.save(str(path))
    index, load = spent(lambda: Index.restore(str(path)))
    for width in (16, 32, 64, 96, 128):
        index.expansion_search = width
        yield Made(
            f"usearch, expansion {width}",
            lambda q: index.search(q, K, threads=1).keys.astype(np.int64),
            build, path.stat().st_size, load,
        )  # fmt: skip


def kdtree(z: np.ndarray, folder: Path) -> Iterator[Made]:
    """Scipy's k-d tree, exact and within 1 %."""
    from scipy.spatial import cKDTree

    tree, build = spent(lambda: cKDTree(z))
    for eps in (0.0, NEAR - 1.0):

        def search(q: np.ndarray, eps: float = eps) -> np.ndarray:
            return tree.query(q, k=K, eps=eps)[1]

        yield Made(f"scipy cKDTree, eps {eps:.2g}", search, build, z.nbytes, build, 16)


LIBRARIES = {
    "walk": (walk, "numba"),
    "exact": (exact, "numba"),
    "hnswlib": (hnswlib, "hnswlib"),
    "faiss": (faiss, "faiss"),
    "ivf": (ivf, "faiss"),
    "flat": (flat, "faiss"),
    "usearch": (usearch, "usearch"),
    "kdtree": (kdtree, "scipy"),
}


def spent(work: Callable) -> tuple[object, float]:
    """What a call gives and its processor time [s]."""
    began = time.process_time()
    return work(), time.process_time() - began


def main(
    rows: Annotated[str, typer.Option(help="stored rows")] = "100000",
    spaces: Annotated[str, typer.Option(help="of " + ", ".join(SPACES))] = ",".join(SPACES),
    libraries: Annotated[str, typer.Option(help="which")] = ",".join(LIBRARIES),
    queries: Annotated[int, typer.Option(help="people at most")] = 1500,
    clips: Annotated[Path, typer.Option(help="folder of motion files to take people from")] = None,
    data: Annotated[Path, typer.Option(help="folder of the tables")] = Path("data"),
    cache: Annotated[Path, typer.Option(help="keeps the poses from run to run (.npy)")] = None,
) -> None:
    """Print the table."""
    sizes = [int(size) for size in rows.split(",")]
    use_threads(1)
    made = worlds(data, clips, max(sizes), spaces.split(","), queries, cache)
    print(
        f"{'':28}{'space':>9}{'rows':>9}{'build s':>9}{'MB':>7}{'load s':>8}{'us p50':>9}"
        f"{'p99':>9}{'wall p50':>9}{'within 1 %':>12}{'recall@8':>10}"
    )
    for space, world in made.items():
        for size in sizes:
            part = World(world.stored[:size], world.queries)
            true = true_distances(part), true_distances(part, K)
            for name in libraries.split(","):
                make, module = LIBRARIES[name]
                if importlib.util.find_spec(module) is None:
                    print(f"{name:28}{space:>9}{size:9d}  not installed")
                    continue
                with tempfile.TemporaryDirectory() as folder:
                    for one in make(part.stored, Path(folder)):
                        line(one, space, part, true)


def line(one: Made, space: str, world: World, true: tuple[np.ndarray, np.ndarray]) -> None:
    """Measure one setting and print it."""
    queries, nearest, last = (part[:: one.share] for part in (world.queries, *true))
    cpu, wall, rows = timed(lambda q: one.search(q).copy(), queries)
    far = world.stored[np.array(rows)].astype(float) - queries[:, None]
    far = np.linalg.norm(far, axis=2)
    print(
        f"{one.label:28}{space:>9}{len(world.stored):9d}{one.build:9.1f}{one.size / 1e6:7.0f}"
        f"{one.load:8.2f}{np.median(cpu):9.1f}{np.quantile(cpu, 0.99):9.1f}{np.median(wall):9.1f}"
        f"{(far[:, 0] <= NEAR * nearest).mean():12.4f}"
        f"{(far <= (1 + 1e-6) * last[:, None]).mean():10.4f}",
        flush=True,
    )


if __name__ == "__main__":
    typer.run(main)
