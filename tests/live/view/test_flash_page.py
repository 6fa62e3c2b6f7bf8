"""The page that flashes, as files that are served to this computer."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
from contextlib import contextmanager
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import urlopen

import pytest

from dart_lab.live.view.flash_page import FLASH_CONTENT_TYPES, load_flash_assets, serve_flash_page

PREBUILT = Path(__file__).parents[3] / "firmware" / "prebuilt" / "dart_nano.hex"


@contextmanager
def served_page():
    with serve_flash_page(PREBUILT) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield f"http://localhost:{server.server_port}/"
        server.shutdown()
        thread.join()


@pytest.mark.slow
def test_it_serves_its_files_and_no_other_on_this_computer_alone():
    with served_page() as url:
        for name, body in load_flash_assets(PREBUILT).items():
            with urlopen(url + name) as answer:
                assert answer.read() == body
                kind = FLASH_CONTENT_TYPES[name.rpartition(".")[2]]
                assert answer.headers["Content-Type"] == kind
        with urlopen(url + "?x") as answer:
            assert b"page.mjs" in answer.read()
        for other in ("../server.py", "flash_page.py", "%2e%2e/server.py", "nothing.mjs"):
            with pytest.raises(HTTPError, match="404"):
                urlopen(url + other)


def test_two_are_served_at_a_time():
    with serve_flash_page(PREBUILT) as one, serve_flash_page(PREBUILT) as other:
        assert one.server_port != other.server_port
        assert {one.server_address[0], other.server_address[0]} == {"127.0.0.1"}


@pytest.mark.slow
@pytest.mark.realtime
def test_the_verb_serves_until_ctrl_c(tmp_path):
    image = tmp_path / "mine.hex"
    image.write_text(":02000000FECF31\n:00000001FF\n")
    verb = [sys.executable, "-m", "dart_hal.cli.main", "flash", str(image), "--browser", "--json"]
    with subprocess.Popen(verb, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                          preexec_fn=heed_ctrl_c) as running:
        try:
            url = json.loads(b"".join(running.stdout.readline() for _ in range(3)))["url"]
            with urlopen(url + "dart_nano.hex") as answer:
                assert answer.read() == image.read_bytes()
            running.send_signal(signal.SIGINT)
            assert running.wait(timeout=20) == 130
        finally:
            running.kill()


def heed_ctrl_c():
    """A shell lets what it runs in the background ignore it, and so what that starts."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
