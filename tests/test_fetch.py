import os

import pooch
import pytest
from handmade import write
from webserver import serving

from s3le.errors import FetchError
from s3le.human import fetch

FAST = {"tries": 3, "timeout": 5.0}


@pytest.fixture
def server(monkeypatch):
    monkeypatch.setenv("no_proxy", "127.0.0.1")
    with serving() as state:
        yield state


@pytest.fixture(autouse=True)
def naps(monkeypatch):
    """How long it would have waited before each further try [s]."""
    slept = []
    monkeypatch.setattr(pooch.core.time, "sleep", slept.append)
    return slept


BODY = bytes(range(256)) * 1000


def get(server, tmp_path, check=lambda part: "", **kwargs):
    target = tmp_path / "deep" / "file"
    fetch.download(f"{server.base}/file", target, check, **(FAST | kwargs))
    return target


def test_a_file_arrives_whole_and_leaves_no_part(server, tmp_path):
    server.files["/file"] = BODY
    target = get(server, tmp_path)
    assert target.read_bytes() == BODY and os.listdir(target.parent) == ["file"]


def test_a_dropped_connection_is_tried_again_and_leaves_no_part(server, tmp_path):
    server.files["/file"], server.drop_after = BODY, [100_000, 50_000]
    target = get(server, tmp_path)
    assert target.read_bytes() == BODY and os.listdir(target.parent) == ["file"]
    assert len(server.requests) == 3


def test_a_file_cut_short_in_every_try_is_refused_and_what_was_there_is_gone(server, tmp_path):
    server.files["/file"], server.drop_after = BODY, [1000, 1000, 1000]
    write(tmp_path / "deep" / "file", b"damaged")
    with pytest.raises(FetchError, match="1000 bytes read, 255000 more expected.* .in 3 tries"):
        get(server, tmp_path)
    assert os.listdir(tmp_path / "deep") == [] and len(server.requests) == 3
    assert get(server, tmp_path).read_bytes() == BODY


def test_a_file_in_place_is_replaced(server, tmp_path):
    server.files["/file"] = BODY
    write(tmp_path / "deep" / "file", b"damaged")
    assert get(server, tmp_path).read_bytes() == BODY


def test_tries_are_further_and_further_apart(server, tmp_path, naps):
    server.files["/file"], server.status = BODY, [503, 503]
    get(server, tmp_path)
    assert naps == [1, 2]


def test_a_whole_file_that_fails_its_check_is_refused_at_once(server, tmp_path):
    server.files["/file"] = BODY
    with pytest.raises(FetchError, match="/file: not what was asked for"):
        get(server, tmp_path, lambda part: "not what was asked for")
    assert len(server.requests) == 1 and os.listdir(tmp_path / "deep") == []


@pytest.mark.parametrize("status", [500, 503, 429])
def test_a_passing_trouble_is_tried_again(server, tmp_path, status):
    server.files["/file"], server.status = BODY, [status, status]
    assert get(server, tmp_path).read_bytes() == BODY and len(server.requests) == 3


@pytest.mark.parametrize("status", [403, 404, 410])
def test_a_file_that_is_not_there_is_asked_for_once(server, tmp_path, status):
    server.status = [status]
    with pytest.raises(fetch.NotThereError, match=f"HTTP status {status}"):
        get(server, tmp_path)
    assert len(server.requests) == 1


@pytest.mark.parametrize("lengths", [True, False])
def test_a_file_without_end_is_refused_at_the_limit(server, tmp_path, lengths):
    server.files["/file"], server.lengths = BODY, lengths
    with pytest.raises(FetchError, match="more than the 1000"):
        get(server, tmp_path, limit=1000)
    assert os.listdir(tmp_path / "deep") == []


def test_nobody_at_home_is_told_apart(tmp_path, monkeypatch):
    monkeypatch.setenv("no_proxy", "127.0.0.1")
    with pytest.raises(fetch.UnreachableError, match="in 3 tries"):
        fetch.download("http://127.0.0.1:9/file", tmp_path / "file", lambda part: "", **FAST)


def test_other_schemes_are_not_opened(tmp_path):
    with pytest.raises(FetchError, match="only http:// and https://"):
        fetch.download("file:///etc/hosts", tmp_path / "file", lambda part: "")
