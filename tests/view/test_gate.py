"""Who may talk to the page, at which port, and how much may be dropped on it."""

import socket
from pathlib import Path
from urllib.error import HTTPError
from urllib.parse import urlsplit
from urllib.request import urlopen

import pytest

from vispeg.cli.main import main
from vispeg.core.errors import UserError
from vispeg.view.gate import Gate, free_port, limit_uploads, opener

viser = pytest.importorskip("viser", reason="the extra 'view' is not installed")
websockets = pytest.importorskip("websockets", reason="the extra 'view' is not installed")
client = pytest.importorskip("websockets.sync.client")
messages = pytest.importorskip("viser._messages")
msgspec = pytest.importorskip("msgspec")


PROTOCOL = [f"viser-v{viser.__version__}"]


@pytest.fixture
def gated():
    """A server behind a gate that takes 1,000 bytes in all, its address, and its button for files."""
    gate = Gate()
    with gate.guarding():
        server = viser.ViserServer(host="127.0.0.1", port=free_port(None), verbose=False)
    limit_uploads(server, 1000)
    yield server, gate.url(server.get_port()), server.gui.add_upload_button("Drop")
    server.stop()


def bare(url):
    at = urlsplit(url)
    return f"http://{at.netloc}", f"ws://{at.netloc}", at.query


def test_the_page_and_its_websocket_need_the_token_and_the_page_s_own_address(gated):
    server, url, _ = gated
    http, ws, query = bare(url)
    for wrong in ("/", "/?token=", "/?token=x", f"/{query}", f"/?{query[:-1]}", f"/?{query}x", f"/?token=x&{query}"):
        with pytest.raises(HTTPError, match="403"):
            urlopen(http + wrong)
        with pytest.raises(websockets.InvalidStatus, match="403"):
            client.connect(ws + wrong, origin=http, subprotocols=PROTOCOL)
    others = ["https://elsewhere.example", http.replace("127.0.0.1", "localhost"), http + "0", "null", None]
    for origin in others:
        with pytest.raises(websockets.InvalidStatus, match="403"):
            client.connect(f"{ws}/?{query}", origin=origin, subprotocols=PROTOCOL)
    with urlopen(url) as page:  # follows the way to the address that holds the websocket's
        assert page.status == 200 and b"viser" in page.read().lower()
        assert page.headers["X-Frame-Options"] == "DENY" and page.headers["Referrer-Policy"] == "no-referrer"
    client.connect(f"{ws}/?{query}", origin=http, subprotocols=PROTOCOL).close()
    assert Gate().token != Gate().token


def sent(socket, message):
    socket.send(msgspec.msgpack.encode({"type": type(message).__name__, **vars(message)}))


def dropped(socket, button, name, parts, said, announced=None):
    """Sends a file as the page's script does, of `said` bytes, or the first of `announced` parts."""
    uuid, head = f"transfer-{name}", button._impl.uuid
    sent(socket, messages.FileTransferStartUpload(head, uuid, name, "text/csv", announced or len(parts), said))
    for i, part in enumerate(parts):
        sent(socket, messages.FileTransferPart(head, uuid, i, part))


def test_what_is_dropped_has_a_limit_in_all_and_its_own_size(gated):
    import time

    server, url, button = gated
    http, ws, query = bare(url)
    with client.connect(f"{ws}/?{query}", origin=http, subprotocols=PROTOCOL) as socket:
        dropped(socket, button, "fits.csv", [b"a" * 300, b"b" * 300], 600)
        for _ in range(100):
            if button.value.name:
                break
            time.sleep(0.05)
        assert button.value.name == "fits.csv" and len(button.value.content) == 600
        dropped(socket, button, "too-much.csv", [b"c" * 401], 401)  # 400 are left
        dropped(socket, button, "liar.csv", [b"d" * 900], 10)
        dropped(socket, button, "last.csv", [b"e" * 300], 300)
        for _ in range(100):
            if button.value.name == "last.csv":
                break
            time.sleep(0.05)
        assert button.value.name == "last.csv"
        assert not server.gui._current_file_upload_states  # nothing of the refused is held


def test_an_upload_that_is_cut_or_refused_takes_no_room(gated):
    """A file that is longer than announced, and a window that is closed while its file is sent."""
    import time

    server, url, button = gated
    http, ws, query = bare(url)
    arriving, until = server.gui._current_file_upload_states, time.monotonic() + 20
    with client.connect(f"{ws}/?{query}", origin=http, subprotocols=PROTOCOL) as socket:
        pose = (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 1.0, 0.01, 100.0, 480, 640, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)
        sent(socket, messages.ViewerCameraMessage(*pose))  # a window begins with it
        dropped(socket, button, "liar.csv", [b"a" * 900, b"a"], 900)
        dropped(socket, button, "cut.csv", [b"b" * 300], 900, announced=2)
        while "transfer-cut.csv" not in arriving and time.monotonic() < until:
            time.sleep(0.02)
        assert [*arriving] == ["transfer-cut.csv"]
    with client.connect(f"{ws}/?{query}", origin=http, subprotocols=PROTOCOL) as socket:
        while arriving and time.monotonic() < until:
            time.sleep(0.02)
        dropped(socket, button, "fits.csv", [b"c" * 500, b"c" * 500], 1000)
        while button.value.name != "fits.csv" and time.monotonic() < until:
            time.sleep(0.02)
    assert button.value.name == "fits.csv" and len(button.value.content) == 1000


@pytest.mark.parametrize("port", [0, -1, 65536, 10**20])
def test_a_port_out_of_range_is_refused(port, capsys):
    with pytest.raises(UserError, match="1 to 65535"):
        free_port(port)
    assert main(["view", "--no-browser", "--port", str(port)]) == 2
    assert f"--port: is no port; expected 1 to 65535; got {port}" in capsys.readouterr().err


def test_a_taken_port_is_refused_in_one_line_and_otherwise_passed_over(tmp_path, capsys):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert main(["view", "--no-browser", "--port", str(port), "--out", str(tmp_path / "o")]) == 2
        said = capsys.readouterr()
        assert not said.out and len(said.err.splitlines()) == 1 and "listens there already" in said.err
        assert not (tmp_path / "o").exists()
    first = free_port(None)
    with socket.socket() as taken:
        taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        taken.bind(("127.0.0.1", first))
        taken.listen()
        assert free_port(None) != first


def test_the_way_for_the_browser_is_this_account_s_alone(tmp_path):
    way = opener(tmp_path / "out", "http://127.0.0.1:8080/?token=t")
    assert way.stat().st_mode & 0o077 == 0 and "token=t" in Path(way).read_text()
