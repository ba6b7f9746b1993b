"""Pickles are read as data: what is data comes out as it went in, and nothing else is done."""

import collections
import io
import os
import pickle
import struct
import time
import tracemalloc
import zipfile
import zlib

import bodies
import estimators
import numpy as np
import pytest
from frankmocaps import BODY, CAMERA
from test_keypoints import same, save

from s3le.errors import ClipError
from s3le.human.keypoints import tensors
from s3le.human.keypoints.how import How
from s3le.human.read import read_clip
from s3le.inert import names, pickles

# What torch 2 makes of a tensor, with the storage's bytes cut short; FrankMocap keeps one.
TENSOR = (
    b"ctorch._utils\n_rebuild_tensor_v2\n(ctorch.storage\n_load_from_bytes\n(U\x04\x80\x02K\x01tR"
    b"K\x00(K\x02t(K\x01tI00\nccollections\nOrderedDict\n(tRtR"
)


def equal(a, b):
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return isinstance(a, np.ndarray) and a.dtype == b.dtype and np.array_equal(a, b)
    if isinstance(a, dict):
        return isinstance(b, dict) and a.keys() == b.keys() and all(equal(a[k], b[k]) for k in a)
    if isinstance(a, (list, tuple)):
        return type(a) is type(b) and len(a) == len(b) and all(map(equal, a, b))
    return a == b


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_data_comes_out_as_it_went_in(protocol):
    both = np.arange(6.0, dtype=">f4").reshape(2, 3)
    tree = collections.OrderedDict(
        none=None, yes=True, no=False, whole=[0, -1, 255, 70_000, 2**40, -(2**70)],
        real=(1.5, float("inf"), -0.0), words=["", "a b", "ä\n\u4e2d"], empty=[[], {}, ()],
        data=b"\0\xff" * 200, arrays=[both, both, both.T, np.zeros((0, 4)), np.array(3)],
        one=np.float32(0.1), bits=np.array([True, False]), large=np.arange(70_000, dtype="u1"),
        nested={"a": {1: (1, (2, (3, (4, 5))))}}, order=np.asfortranarray(np.eye(3)),
    )  # fmt: skip
    made = pickles.load("a.pkl", pickle.dumps(tree, protocol))
    want = dict(tree, one=float(np.float32(0.1)))
    assert equal(made, want)


def test_what_is_shared_stays_shared_and_a_list_may_hold_itself():
    own = [1]
    own.append(own)
    made = pickles.load("a", pickle.dumps({"a": own, "b": own}))
    assert made["a"] is made["b"] and made["a"][1] is made["a"]


class Runs:
    """What runs a program when it is unpickled."""

    def __init__(self, *given):
        self.given = given

    def __reduce__(self):
        return self.given


class State:
    """What is set up by a state of its own."""

    def __setstate__(self, state):
        raise AssertionError("called")

    def __reduce__(self):
        return (State, (), {"a": 1})


def persistent(value):
    stream = io.BytesIO()
    pickler = pickle.Pickler(stream, 2)
    pickler.persistent_id = lambda v: "me" if v == value else None
    pickler.dump([value])
    return stream.getvalue()


def doubled(depth):
    """Lists of lists of the same two, 2^depth of them in a few bytes."""
    return b"\x80\x02]q\0K\x01a" + b"".join(b"0]q%c(h%ch%ce" % (i + 1, i, i) for i in range(depth))


def last_of(data):
    return b"\x80\x02}U\x06joints" + data[2:] + b"s."


def array(shape=b"(K\x02t", code="f8", state=b"", data=b"\0" * 16):
    """An array of numpy's by hand."""
    made = b"\x80\x02cnumpy.core.multiarray\n_reconstruct\n(cnumpy\nndarray\n(K\0tU\x01btR"
    kind = b"cnumpy\ndtype\n(U%c%sI00\nI01\ntR" % (len(code), code.encode()) + state
    return made + b"(K\x01" + shape + kind + b"I00\nU%c%stb." % (len(data), data)


WRAP = b"\x80\x02cjoblib.numpy_pickle\nNumpyArrayWrapper\n"


def joblib(code=b"f8", shape=b"K\x02\x85", order=b"C", name=b"cnumpy\nndarray\n"):
    """An array as joblib writes it, with numbers for two."""
    state = b"}(U\x08subclass" + name + b"U\x05shape" + shape + b"U\x05orderU\x01" + order
    state += b"U\x05dtypecnumpy\ndtype\n(U\x02" + code + b"I00\nI01\ntRu"
    return WRAP + b")\x81" + state + b"b" + b"\0" * 16 + b"."


HOSTILE = {
    "os.system": (pickle.dumps(Runs(os.system, ("touch pwned",))), "wants to call 'posix.system'"),
    "os.system, old": (b"cos\nsystem\n(S'touch pwned'\ntR.", "wants to call 'os.system'"),
    "eval": (pickle.dumps(Runs(eval, ("open('pwned', 'w')",)), 4), "call 'builtins.eval'"),
    "getattr": (b"c__builtin__\ngetattr\n.", "call '__builtin__.getattr'"),
    "INST": (b"(S'touch pwned'\nios\nsystem\n.", "its instruction INST at byte 16 is not data"),
    "OBJ": (b"(cos\nsystem\nS'touch pwned'\no.", "call 'os.system'"),
    "OBJ of ours": (b"(ccollections\nOrderedDict\no.", "its instruction OBJ"),
    "NEWOBJ": (b"\x80\x02ccollections\nOrderedDict\n)\x81.", "its instruction NEWOBJ"),
    "a class": (pickle.dumps(State()), "call 'test_inert.State'"),
    "a name in a name": (b"\x80\x04\x8c\x05numpy\x8c\x0bos.system\0\x93.", "call|sound"),
    "BUILD a list": (b"]}U\x01aK\x01sb.", "wants to set up list"),
    "BUILD a name": (b"cnumpy\nndarray\n}U\x01aK\x01sb.", "wants to set up name"),
    "REDUCE a word": (b"U\x09os.system(tR.", "wants to call str"),
    "REDUCE a class": (b"cnumpy\nndarray\n(K\x02tR.", "wants to call"),
    "persistent": (persistent(7), "its instruction BINPERSID"),
    "persistent, old": (b"Pme\n.", "its instruction PERSID"),
    "extension": (b"\x80\x02\x82\x01.", "its instruction EXT1"),
    "out of band": (b"\x80\x05\x97.", "its instruction NEXT_BUFFER"),
    "a set": (pickle.dumps({1, 2}), "its instruction EMPTY_SET"),
    "objects": (pickle.dumps(np.array([None, 1], object)), "holds 'O8', which is not numbers"),
    "words": (pickle.dumps(np.array(["a"])), "holds 'U1', which is not numbers"),
    "a record": (pickle.dumps(np.zeros(1, "f8,i4")), "holds 'V12', which is not numbers"),
    "a subarray": (array(state=b"(K\x03U\x01<(cnumpy\ndtype\n(U\x02f8I00\nI01\ntR(K\x02ttNNNJ"
                               b"\xff\xff\xff\xffJ\xff\xff\xff\xffK\0tb"), "something else than"),
    "too little": (array(shape=b"(K\x09t"), r"an array of shape \(9,\) in 16 bytes"),
    "too many": (array(shape=b"(\x8a\x08" + b"\xff" * 7 + b"\x7ft"), "in 16 bytes"),
    "negative": (array(shape=b"(J\xff\xff\xff\xfft"), "an array of shape"),
    "nothing, often": (array(shape=b"(K\0\x8a\x08" + b"\xff" * 7 + b"\x7ft", data=b""), "sound|no"),
    "code": (array(code="f8,f8"), "holds 'f8,f8'"),
    "list data": (pickle.dumps([1])[:-1] + b"b.", "wants to set up|values|sound"),
    "dict key": (b"}(]K\x01u.", "keys that are neither words"),
    "array key": (b"}" + array()[2:-1] + b"K\x01s.", "keys that are neither words"),
    "laughs": (last_of(doubled(60)), "too deep"),
    "no end": (b"K\x01" * 9, "sound pickle"),
    "two values": (b"K\x01K\x02.", "2 values at its end"),
    "more behind": (b"K\x01.K\x02.", "3 bytes after its end"),
    "nothing": (b".", "0 values"),
    "underflow": (b"\x80\x02\x87.", "values are missing"),
    "no memo": (b"h\x07.", "sound pickle"),
    "no mark": (b"K\x01t.", "sound pickle"),
    "long lie": (b"\x80\x04\x8e" + struct.pack("<Q", 2**62) + b"a.", "sound pickle"),
    "million digits": (b"L" + b"9" * 99_999 + b"L\n.", "sound pickle"),
    "text": (b"hello", "sound pickle"),
    "encode": (b"c_codecs\nencode\n(X\x01\0\0\0aU\x05utf-7tR.", "words of it are in 'utf-7'"),
    "a compressor": (b"cjoblib.numpy_pickle\nNumpyArrayWrapper\n.", "a name at its end"),
    "joblib's NEWOBJ of another": (b"\x80\x02ccollections\nOrderedDict\n)\x81.", "NEWOBJ"),
    "joblib without state": (WRAP + b")\x81.", "a wrapper at its end"),
    "joblib in place of numbers": (b"}U\x06joints" + WRAP[2:] + b")\x81s.", "holds no joints"),
    "joblib of objects": (joblib(b"O8"), "holds 'O8', which is not numbers"),
    "joblib of another class": (joblib(name=b"cnumpy\ndtype\n"), "no plain numpy array"),
    "joblib that is too large": (joblib(shape=b"\x8a\x08" + b"\xff" * 7 + b"\x7f\x85"), "bytes"),
    "joblib that is cut": (joblib(shape=b"K\x09\x85"), r"an array of shape \(9,\) in"),
    "joblib of no order": (joblib(order=b"K"), "no plain numpy array"),
    "torch's name alone": (b"ctorch\nFloatStorage\n.", "a name at its end"),
    "torch without storage": (
        b"ctorch._utils\n_rebuild_tensor_v2\n(NK\0(K\x02t(K\x01tI00\nNtR.", "holds no joints"),
    "module tricks": (b"cnumpy.core.multiarray\nfromfile\n.", "call 'numpy.core.multiarray.from"),
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_whatever_is_not_data_is_refused_in_one_line_and_never_done(tmp_path, name, monkeypatch):
    monkeypatch.chdir(tmp_path)
    data, why = HOSTILE[name]
    path = tmp_path / "a.pkl"
    path.write_bytes(data)
    with pytest.raises(ClipError, match=why) as error:
        read_clip(path)
    assert str(path) in str(error.value) and len(str(error.value).splitlines()) == 1
    assert [p.name for p in tmp_path.iterdir()] == ["a.pkl"]


def test_a_bomb_of_instructions_costs_little(tmp_path):
    begin = time.process_time()
    for data in (b"(" * 500_000, b"K\x01" + b"2" * 500_000 + b".",
                 b"]" + b"q\0h\0" * 250_000 + b"."):  # fmt: skip
        (tmp_path / "a.pkl").write_bytes(data)
        with pytest.raises(ClipError, match="more than 400000 instructions|sound"):
            read_clip(tmp_path / "a.pkl")
    assert time.process_time() - begin < 6.0  # [s]


def test_indices_of_the_memory_and_keys_that_are_long_to_hash_cost_little():
    laughs = b"\x80\x02K\x01\x85q\0"  # tuples of the same two, 2^60 of them
    laughs += b"".join(b"0h%ch%c\x86q%c" % (i, i, i + 1) for i in range(60))
    before = time.process_time()
    tracemalloc.start()
    try:
        for data, why in (
            (b"}" + laughs[2:] + b"K\x01s.", "keys that are neither words nor whole numbers"),
            (b"}(" + laughs[2:] + b"K\x01u.", "keys that are neither words nor whole numbers"),
        ):
            with pytest.raises(ClipError, match=why):
                pickles.load("a", data)
        for data in (b"Nr\xff\xff\xff\x7f.", b"Np2147483647\n."):
            assert pickles.load("a", data) is None  # Python's own takes gigabytes for it
        assert tracemalloc.get_traced_memory()[1] < 1 << 20
    finally:
        tracemalloc.stop()
    assert time.process_time() - before < 2.0  # [s]


TENSOR_OF = b"ctorch._utils\n_rebuild_tensor_v2\n((U\x07storagectorch\nFloatStorage\nU\x010U\x03cpu"


def tensor(offset=0, size=(2, 3), stride=(3, 1), count=6, key=b"0", kind=b"FloatStorage"):
    """A tensor of torch's by hand, in a dict of joints."""
    made = TENSOR_OF.replace(b"U\x010", b"U%c%s" % (len(key), key))
    made = made.replace(b"FloatStorage", kind) + whole(count) + b"tQ" + whole(offset)
    made += b"".join(b"(" + b"".join(map(whole, own)) + b"t" for own in (size, stride))
    return b"\x80\x02}U\x06joints" + made + b"I00\nNtRs."


def whole(number):
    return b"\x8a\x08" + struct.pack("<q", number)


def archive(folder, pickled, parts=(("data/0", b"\0" * 24),), byteorder=b"little"):
    path = folder / "a.pt"
    with zipfile.ZipFile(path, "w") as made:
        for name, data in (("data.pkl", pickled), ("byteorder", byteorder), *parts):
            made.writestr(f"archive/{name}", data)
    return path


@pytest.mark.parametrize(
    ("pickled", "parts", "why"),
    [
        (tensor(), (), "holds no joints|24|wanted"),
        (tensor(offset=1), None, r"a tensor of size \(2, 3\) in 6"),
        (tensor(size=(3, 3)), None, r"a tensor of size \(3, 3\) in 6"),
        (tensor(stride=(2**61, 1)), None, "a tensor of size"),
        (tensor(size=(2**40, 3), stride=(0, 1)), None, "refused, a tensor of size"),
        (tensor(size=(-1, 3)), None, "refused, a tensor of size"),
        (tensor(size=(2,)), None, "without sizes or strides"),
        (tensor(count=2**60), None, "a storage of 24 bytes, wanted"),
        (tensor(count=-1), None, "a storage of -1 numbers"),
        (tensor(key=b"../../0"), None, "a storage of None bytes"),
        (tensor(kind=b"BFloat16Storage"), None, "holds no joints"),
        (tensor(kind=b"UntypedStorage"), None, "wants to call 'torch.UntypedStorage'"),
        (b"\x80\x02K\x01Q.", None, "an? tuple wanted|tuple"),
        (pickle.dumps(Runs(os.system, ("touch pwned",)), 2), None, "wants to call 'posix.system'"),
        (b"\x80\x02ctorch._utils\n_rebuild_device_tensor_from_numpy\n.", None, "wants to call"),
    ],
)
def test_a_torch_file_that_is_not_numbers_is_refused_and_never_run(
    tmp_path, pickled, parts, why, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    more = (("data/0", b"\0" * 24),) if parts is None else parts
    path = archive(tmp_path, pickled, more)
    with pytest.raises(ClipError, match=why) as error:
        read_clip(path)
    assert str(path) in str(error.value) and len(str(error.value).splitlines()) == 1
    assert [p.name for p in tmp_path.iterdir()] == ["a.pt"]


def test_a_frame_that_ends_elsewhere_than_its_instructions_is_refused():
    good = estimators.wham(bodies.pose())
    assert pickles.load("a", good)[3]["pose_world"].shape == (12, 72)
    plain = pickle.dumps({"joints": list(range(300))}, 4)
    for data, offs in ((good, (-3, 1, 5)), (plain, (-4, 1, 5))):  # within an instruction, beyond
        at = data.index(b"\x95")
        size = int.from_bytes(data[at + 1 : at + 9], "little")
        for off in offs:
            wrong = data[: at + 1] + (size + off).to_bytes(8, "little") + data[at + 9 :]
            with pytest.raises(ClipError, match="in two frames|in a frame|a frame of it is cut"):
                pickles.load("a", wrong)


def test_a_torch_archive_that_is_none_is_refused(tmp_path, monkeypatch):
    for data, why in ((b"", "no file of torch.save"), (b"PK\3\4" + b"\0" * 90, "no sound file")):
        (tmp_path / "b.pt").write_bytes(data)
        with pytest.raises(ClipError, match=why):
            read_clip(tmp_path / "b.pt")
    with pytest.raises(ClipError, match="numbers of a big-endian machine"):
        read_clip(archive(tmp_path, tensor(), byteorder=b"big"))
    with pytest.raises(ClipError, match="has 2 data.pkl in it, wanted one"):
        read_clip(archive(tmp_path, tensor(), [("b/data.pkl", b"N.")]))
    monkeypatch.setattr(tensors, "MAX_BYTES", 2**20)
    for path, why in (
        (archive(tmp_path, tensor(), [("data/0", b"\0" * 2**21)]), "unpacks to more|longer than"),
        (tmp_path / "c.pkl", "unpacks to more than 1 MiB"),
    ):
        if path.suffix == ".pkl":
            path.write_bytes(zlib.compress(b"\0" * 2**22))
        with pytest.raises(ClipError, match=why):
            read_clip(path)
    (tmp_path / "d.pkl").write_bytes(zlib.compress(pickle.dumps([1]))[:-3])
    with pytest.raises(ClipError, match="its end is missing"):
        read_clip(tmp_path / "d.pkl")


def test_what_is_named_often_is_made_once(tmp_path):
    big = 8 << 20  # [bytes]
    text = b"X" + struct.pack("<I", big) + b"a" * big
    held = b"\x80\x05" + text + b"\x940c_codecs\nencode\n\x940]"
    held += b"h\x01(h\0X\x06\0\0\0latin1tRa" * 2000 + b"."
    array = b"\x80\x05\x96" + struct.pack("<Q", big) + b"\0" * big + b"\x940"
    array += b"cnumpy.core.numeric\n_frombuffer\n\x940cnumpy\ndtype\n(X\x02\0\0\0u1tR\x940]"
    array += b"h\x01(h\0h\x02J" + struct.pack("<i", big) + b"\x85X\x01\0\0\0CtRa"
    array = array + (b"h\x01(h\0h\x02J" + struct.pack("<i", big) + b"\x85X\x01\0\0\0CtRa") * 2000
    number = b"\x80\x05\x8b" + struct.pack("<i", big) + b"\x01" * big + b"\x940}"
    number += b"h\0K\x01s" * 2000 + b"."
    older = (b"\x80\x02\x8a\x0al\xfc\x9cF\xf9 j\xa8P\x19.\x80\x02M\xe9\x03."
             b"\x80\x02}U\x0dlittle_endian\x88s.\x80\x02(U\x07storagectorch\nFloatStorage\n"
             b"U\x01aU\x03cpu" + whole(big // 4) + b"NtQ.\x80\x02]U\x01aa."
             + struct.pack("<q", big // 4) + b"\0" * big)  # fmt: skip
    torch = b"\x80\x05\x8e" + struct.pack("<Q", len(older)) + older + b"\x940]"
    torch += b"ctorch.storage\n_load_from_bytes\nh\0\x85Ra" * 2000 + b"."
    tracemalloc.start()
    try:
        storages = pickles.load("a", torch)
        assert len(storages) == 2000 and storages[0].shape == (big // 4,)
        assert len(pickles.load("a", held)) == 2000
        assert len(pickles.load("a", array + b".")) == 2001
        with pytest.raises(ClipError, match="keys that are neither"):
            pickles.load("a", number)
        laughs = doubled(40)  # in the place of a dtype's name
        with pytest.raises(ClipError, match="which is not numbers"):
            pickles.load("a", laughs[:-1] + b"e0cnumpy\ndtype\n(h\x28tR.")
        assert tracemalloc.get_traced_memory()[1] < 10 * big
    finally:
        tracemalloc.stop()


def test_any_pickle_of_plain_joints_is_a_clip(tmp_path):
    path = tmp_path / "a.pkl"
    path.write_bytes(pickle.dumps({"joints3d": CAMERA, "fps": 25, "who": {"a": [1, "b"]}}))
    clip = read_clip(path)
    same(clip, BODY)
    assert clip.fps == 25.0
    people = {i: {"smpl_pose": bodies.pose()[:, 3:], "smpl_orient_world": bodies.pose()[:, :3]}
              for i in (0, 3)}  # fmt: skip
    path.write_bytes(pickle.dumps({"person_data": people}))
    with pytest.raises(ClipError, match=r"holds 2 persons \(0, 3\)"):
        read_clip(path)
    assert read_clip(path, how=How(person=3)).reading.how[:2] == ("smpl", "y-up")


WORDS = (
    "joints", "frames", "people", "person_data", "0", "7", "pose_keypoints_3d", "joint_names",
    "fps", "time", "visibility", "left_hip", "poses", "trans", "smpl_pose", "smpl_orient_world",
    "track_ids", "x", "y", "z", "kp_2d",
)  # fmt: skip


def tree(dice, depth=0):
    """Something that JSON can hold, of words that readers look for."""
    kind = dice.integers(7 if depth < 4 else 4)
    if kind < 4:
        return [None, True, "word", 1.5, -3, 10**400, "9" * 30][dice.integers(7)]
    if kind == 4:
        shape = [(), (0,), (17,), (3, 17, 3), (2, 24, 3), (5, 72), (4, 2, 17, 3), (2, 3), (3, 75)]
        return dice.normal(size=shape[dice.integers(len(shape))]).round(2).tolist()
    if kind == 5:
        return [tree(dice, depth + 1) for _ in range(dice.integers(4))]
    words = dice.choice(WORDS, dice.integers(5)).tolist()
    return {word: tree(dice, depth + 1) for word in words}


def test_no_tree_of_any_form_does_anything_but_read_or_be_refused(tmp_path):
    for number in range(600):
        held = tree(np.random.default_rng(number))
        with pytest.raises(ClipError, match="a.json"):
            read_clip(save(tmp_path, "a.json", {"joints": held} if number % 3 else {"a": held}))
        path = tmp_path / "a.pkl"
        path.write_bytes(pickle.dumps(held))
        with pytest.raises(ClipError, match="a.pkl"):
            read_clip(path)


# --- FrankMocap


def test_frankmocaps_tensors_stay_closed():
    made = pickles.load("a", b"}(U\x10img_cropped_norm" + TENSOR + b"U\x01aK\x01u.")
    assert made == {"img_cropped_norm": names.CLOSED, "a": 1}
