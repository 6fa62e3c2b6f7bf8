"""``data fetch``: the right bytes from anywhere, and never a wrong one."""

from __future__ import annotations

import gzip
import json
import tarfile
import threading
import zipfile
from functools import partial
from hashlib import sha256
from http.server import BaseHTTPRequestHandler, SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from dart_hal.cli.main import main
from dart_hal.core.errors import FetchFailed
from dart_hal.recording.fetch import bring, data_folder, fetch, find, load
from dart_hal.recording.fetch.published import LIST, NOTICE, ROOTS
from tests.common import EXCERPT

CUT = "83_4_april_2025_MPCC_rosbag/csv/2025-04-04-15-23-12.csv"
FETCHED_FILES = ("10_steps/a.csv", "10_steps/b.csv", "50_tyres/csv/c.csv")


@pytest.fixture
def originals(tmp_path):
    """A folder of three made recordings, as the makers would publish them."""
    root = tmp_path / "originals"
    for i, name in enumerate(FETCHED_FILES):
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"elapsed time sensors,throttle\r\n" + b"1.0,%d\r\n" % i * (400 + i))
    return root


def digest(path: Path) -> str:
    return sha256(path.read_bytes()).hexdigest()


@pytest.fixture
def known_digests(originals):
    return {name: digest(originals / name) for name in FETCHED_FILES}


@pytest.fixture
def destination(tmp_path):
    return tmp_path / "to"


def complete(destination: Path, known_digests) -> bool:
    return all(digest(destination / path) == known for path, known in known_digests.items())


def leftovers(destination: Path) -> list[str]:
    """Files that were not requested."""
    known = {Path(n).name for n in FETCHED_FILES} | {"LICENSE"}
    return [p.name for p in destination.rglob("*") if p.is_file() and p.name not in known]


# ---- the list itself

def test_every_file_of_the_excerpt_is_a_published_one():
    published = load()
    found = sorted(EXCERPT.rglob("*.csv.gz"))
    assert len(found) > 60
    cut = []
    for path in found:
        name = path.relative_to(EXCERPT).as_posix().removesuffix(".gz")
        data = gzip.decompress(path.read_bytes())
        if sha256(data).hexdigest() != published[name]:
            cut.append(name)
        assert path.read_bytes()[4:8] == bytes(4), f"{name}: the time of packing is 0"
    assert cut == [CUT], "the one that the README names as cut"


def test_the_excerpt_keeps_its_size_and_its_notice():
    files = [p for p in EXCERPT.rglob("*") if p.is_file()]
    assert sum(p.stat().st_size for p in files) <= 2_000_000
    assert NOTICE.read_bytes() == (EXCERPT / "LICENSE").read_bytes()
    readme = (EXCERPT / "README.md").read_text()
    assert "Lorenzo-Lyons/DART" in readme
    assert "Copyright (c) 2024 Lorenzo Lyons" in readme
    folders = {p.relative_to(EXCERPT).parts[0] for p in files if p.suffix == ".gz"}
    assert [f for f in folders if f"| {f} |" not in readme] == []


def test_the_list_names_83_files_once_each_below_the_folder():
    known_digests = load()
    assert len(known_digests) == len(set(known_digests.values())) == 83
    assert all(len(known) == 64 for known in known_digests.values())
    assert all(".." not in path and not path.startswith("/") for path in known_digests)


@pytest.mark.recordings
def test_the_list_is_that_of_the_full_set(recordings, tmp_path):
    """As the tool lists a folder; a licence and a page about it are no recordings."""
    import pooch

    pooch.make_registry(str(recordings), str(tmp_path / "list"))
    lines = [line for line in (tmp_path / "list").read_text().splitlines() if ".csv" in line]
    assert sorted(lines) == sorted(LIST.read_text().splitlines()[1:])


# ---- where it goes

def test_data_folder_is_the_named_one_else_ours(monkeypatch, tmp_path):
    monkeypatch.setenv("DART_DATA", str(tmp_path / "named"))
    assert data_folder() == tmp_path / "named"
    monkeypatch.delenv("DART_DATA")
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert data_folder() == tmp_path / "dart-hal" / "recordings"


def test_a_name_is_looked_for_here_before_the_data_folder(monkeypatch, originals, tmp_path):
    monkeypatch.setenv("DART_DATA", str(originals))
    monkeypatch.chdir(tmp_path)
    assert find(["10_steps"]) == [originals / "10_steps"]
    (tmp_path / "10_steps").mkdir()
    assert find(["10_steps"]) == [Path("10_steps")]
    assert find([]) == [originals]
    assert find(["nowhere"]) == [Path("nowhere")]


# ---- from a folder

def test_from_a_folder_of_any_layout(originals, known_digests, destination, tmp_path):
    flat = tmp_path / "flat"
    flat.mkdir()
    for i, name in enumerate(FETCHED_FILES):
        (flat / f"renamed{i}.csv").write_bytes((originals / name).read_bytes())
    packed = flat / "renamed1.csv"
    (flat / "x.csv.gz").write_bytes(gzip.compress(packed.read_bytes()))
    packed.unlink()
    outcome = fetch(str(flat), destination, registry=known_digests)
    assert outcome.complete
    assert complete(destination, known_digests)
    assert "MIT License" in (destination / "LICENSE").read_text()
    assert leftovers(destination) == []


def test_what_is_right_is_left_alone_and_a_stopped_fetch_goes_on(originals, known_digests,
                                                                 destination):
    fetch(str(originals), destination, registry=known_digests)
    before = {n: (destination / n).stat().st_mtime_ns for n in FETCHED_FILES}
    (destination / FETCHED_FILES[1]).unlink()
    outcome = fetch(str(originals), destination, registry=known_digests)
    assert outcome.fetched == [FETCHED_FILES[1]]
    assert outcome.present == [FETCHED_FILES[0], FETCHED_FILES[2]]
    assert all((destination / n).stat().st_mtime_ns == before[n] for n in (FETCHED_FILES[0],
                                                                           FETCHED_FILES[2]))


def test_a_complete_folder_needs_no_source(originals, known_digests):
    outcome = fetch("http://127.0.0.1:9/none", originals, registry=known_digests)
    assert outcome.complete
    assert outcome.sources == []
    assert not (originals / "LICENSE").exists(), "nothing is written where nothing was missing"


def test_one_wrong_byte_is_refused_and_never_kept(originals, known_digests, destination):
    path = originals / FETCHED_FILES[0]
    data = bytearray(path.read_bytes())
    data[100] ^= 1
    path.write_bytes(bytes(data))
    outcome = fetch(str(originals), destination, registry=known_digests)
    assert not outcome.complete
    assert [r.path for r in outcome.refused] == [FETCHED_FILES[0]]
    assert "SHA-256" in outcome.refused[0].found
    assert not (destination / FETCHED_FILES[0]).exists()
    assert leftovers(destination) == []


def test_another_file_of_that_name_is_set_aside(originals, known_digests, destination):
    (destination / FETCHED_FILES[0]).parent.mkdir(parents=True)
    (destination / FETCHED_FILES[0]).write_bytes(b"mine")
    outcome = fetch(str(originals), destination, registry=known_digests)
    assert outcome.complete
    assert outcome.replaced == [FETCHED_FILES[0]]
    assert (destination / f"{FETCHED_FILES[0]}.old").read_bytes() == b"mine"
    assert complete(destination, known_digests)


def test_a_folder_without_any_of_them_is_refused(known_digests, destination, tmp_path):
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "x.csv").write_text("a\n1\n")
    for source in (tmp_path / "other", tmp_path / "absent"):
        with pytest.raises(FetchFailed) as caught:
            fetch(str(source), destination, registry=known_digests)
        assert "git clone" in caught.value.remedy
        assert "$DART_DATA" in caught.value.remedy
    assert not destination.exists()


# ---- from an archive

def as_zip(root: Path, path: Path) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as out:
        for file in root.rglob("*.csv"):
            out.write(file, f"DART-7c30162/Data/{file.relative_to(root)}")
        out.writestr("../../outside.csv", "a\n1\n")
    return path


def as_tar(root: Path, path: Path) -> Path:
    with tarfile.open(path, "w:gz") as out:
        out.add(root, "DART/Data")
    return path


@pytest.mark.parametrize("pack", [as_zip, as_tar])
def test_from_an_archive(originals, known_digests, destination, tmp_path, pack):
    name = "x.zip" if pack is as_zip else "x.tar.gz"
    outcome = fetch(str(pack(originals, tmp_path / name)), destination, registry=known_digests)
    assert outcome.complete
    assert complete(destination, known_digests)
    assert sorted(p.name for p in destination.rglob("*") if p.is_file()) == [
        "LICENSE", "a.csv", "b.csv", "c.csv"], "nothing but what is listed is unpacked"


@pytest.mark.parametrize("pack", [as_zip, as_tar])
def test_a_cut_archive_is_refused(originals, known_digests, destination, tmp_path, pack):
    path = pack(originals, tmp_path / "x")
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(FetchFailed, match="not a whole archive"):
        fetch(str(path), destination, registry=known_digests)
    assert leftovers(destination) == []


@pytest.mark.parametrize("change", ["encrypted", "method"])
def test_an_archive_that_cannot_be_unpacked_is_refused(originals, known_digests, destination,
                                                       tmp_path, change):
    path = as_zip(originals, tmp_path / "x.zip")
    data = bytearray(path.read_bytes())
    for mark, flags, method in ((b"PK\x01\x02", 8, 10), (b"PK\x03\x04", 6, 8)):
        at = data.find(mark)
        while at >= 0:
            data[at + (flags if change == "encrypted" else method)] = 1 if change == "encrypted" \
                else 97
            at = data.find(mark, at + 4)
    path.write_bytes(bytes(data))
    with pytest.raises(FetchFailed, match="not a whole archive"):
        fetch(str(path), destination, registry=known_digests)
    assert leftovers(destination) == []


# ---- from a server on this machine

@pytest.fixture
def serve():
    """``serve(handler class)`` -> base address."""
    running = []

    def start(handler) -> str:
        server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
        threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        running.append(server)
        return f"http://127.0.0.1:{server.server_address[1]}"
    yield start
    for server in running:
        server.shutdown()
        server.server_close()


def quiet(folder: Path):
    class Handler(SimpleHTTPRequestHandler):
        def log_message(self, *args): ...
    return partial(Handler, directory=str(folder))


def answering(change):
    """A server whose answer to any path is ``change(path)`` -> (status, claimed length, body)."""
    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            status, length, body = change(self.path)
            self.send_response(status)
            self.send_header("Content-Length", str(length))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *args): ...
    return Handler


def test_from_a_base_address_and_its_root_folders(originals, known_digests, destination, serve,
                                                  tmp_path):
    web = tmp_path / "web" / ROOTS[1]
    web.parent.mkdir(parents=True)
    originals.rename(web)
    outcome = fetch(serve(quiet(tmp_path / "web")), destination, registry=known_digests)
    assert outcome.complete
    assert complete(destination, known_digests)


def test_from_the_address_of_an_archive(originals, known_digests, destination, serve, tmp_path):
    as_zip(originals, tmp_path / "x.zip")
    reports = []
    outcome = fetch(serve(quiet(tmp_path)) + "/x.zip", destination, registry=known_digests,
                    progress=lambda done, total, name: reports.append((done, total)))
    assert outcome.complete
    assert all(0 <= done <= total for done, total in reports)


def test_the_repository_is_tried_file_by_file_then_as_an_archive(
        originals, known_digests, destination, serve, tmp_path, monkeypatch):
    (tmp_path / "empty").mkdir()
    as_zip(originals, tmp_path / "x.zip")
    monkeypatch.setattr(bring, "RAW_URL", serve(quiet(tmp_path / "empty")))
    monkeypatch.setattr(bring, "ARCHIVE_URL", serve(quiet(tmp_path)) + "/x.zip")
    outcome = fetch(None, destination, registry=known_digests)
    assert outcome.complete
    assert len(outcome.sources) == 2


@pytest.mark.parametrize(("change", "found"), [
    (lambda data: (200, len(data), bytes([data[0] ^ 1]) + data[1:]), "SHA-256"),
    (lambda data: (200, len(data) - 50, data[:-50]), "bytes"),
    (lambda data: (200, len(data) + 50, data + b" " * 50), "bytes"),
    (lambda data: (200, 30, b"<!DOCTYPE html><html>no</html>"), "a web page"),
], ids=["a byte", "short", "long", "error page"])
def test_wrong_answers_are_refused(originals, known_digests, destination, serve, change, found):
    def answer(path):
        data = (originals / path.lstrip("/")).read_bytes() if path.endswith(".csv") else b""
        return change(data) if path == f"/{FETCHED_FILES[0]}" else (200, len(data), data)
    outcome = fetch(serve(answering(answer)), destination, registry=known_digests)
    assert [r.path for r in outcome.refused] == [FETCHED_FILES[0]]
    assert found in outcome.refused[0].found
    assert not (destination / FETCHED_FILES[0]).exists()
    assert sorted(outcome.fetched) == sorted(FETCHED_FILES[1:])
    assert leftovers(destination) == []


def test_a_line_that_breaks_is_reported_and_the_next_fetch_goes_on(originals, known_digests,
                                                               destination, serve):
    broken = [f"/{FETCHED_FILES[1]}"]

    def answer(path):
        data = (originals / path.lstrip("/")).read_bytes()
        return 200, len(data), data[:-50] if path in broken else data
    base = serve(answering(answer))
    with pytest.raises(FetchFailed) as caught:
        fetch(base, destination, registry=known_digests)
    assert "the same command resumes" in caught.value.remedy
    assert [p.name for p in destination.rglob("*") if p.is_file()] == [Path(FETCHED_FILES[0]).name]
    broken.clear()
    outcome = fetch(base, destination, registry=known_digests)
    assert (outcome.present, outcome.fetched) == ([FETCHED_FILES[0]], list(FETCHED_FILES[1:]))
    assert complete(destination, known_digests)


@pytest.mark.parametrize("status", [403, 500])
def test_a_server_that_refuses_is_an_error_with_a_way_out(known_digests, destination, serve,
                                                          status):
    with pytest.raises(FetchFailed) as caught:
        fetch(serve(answering(lambda path: (status, 0, b""))), destination, registry=known_digests)
    assert str(status) in caught.value.found
    for way in ("git clone", "--from", "$DART_DATA"):
        assert way in caught.value.remedy


# ---- the verb

def run(capsys, *args) -> tuple[int, dict, str]:
    with pytest.raises(SystemExit) as left:
        main(["data", "fetch", *map(str, args)])
    captured = capsys.readouterr()
    assert "Traceback" not in captured.out + captured.err
    return int(left.value.code
               or 0), json.loads(captured.out) if "--json" in args else {}, captured.out


@pytest.mark.slow
def test_the_verb_brings_what_the_excerpt_has_and_names_what_lacks(capsys, destination):
    code, out, _ = run(capsys, "--from", EXCERPT, "--to", destination, "--json")
    assert code == 1
    assert len(out["fetched"]) == len(list(EXCERPT.rglob("*.csv.gz"))) - 1
    assert len(out["fetched"]) + len(out["missing"]) + len(out["refused"]) == out["files"] == 83
    assert [r["path"] for r in out["refused"]] == [CUT]
    code, out, errors = run(capsys, "--from", EXCERPT, "--to", destination)
    assert (code, out) == (1, {})
    assert "git clone" in errors
    assert f"refused {CUT}" in errors


def test_no_network_is_one_error_with_what_to_do(capsys, destination, monkeypatch):
    monkeypatch.setattr(bring, "RAW_URL", "http://127.0.0.1:9")
    code, out, _ = run(capsys, "--to", destination, "--json")
    assert code == 2
    assert out["error"]["code"] == "D-REC-03"
    for way in ("git clone", "--from", "$DART_DATA"):
        assert way in out["error"]["try"]
    assert not destination.exists() or not any(destination.rglob("*.csv"))


def test_an_archive_that_is_a_web_page_is_refused(capsys, destination, tmp_path):
    (tmp_path / "x.zip").write_bytes(b"<html>404</html>")
    code, out, _ = run(capsys, "--from", tmp_path / "x.zip", "--to", destination, "--json")
    assert code == 2
    assert "not a whole archive" in out["error"]["what"]
