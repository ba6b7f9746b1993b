"""A web server on this machine that misbehaves on request."""

import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer


class Server:
    """Files by path, how to misbehave, and what was asked for."""

    def __init__(self):
        self.files, self.requests = {}, []
        self.drop_after = []  # bytes to send before hanging up, one for each answer
        self.status = []  # statuses to answer with, one for each request
        self.lengths = True


@contextmanager
def serving():
    """Run a server; yields its state, whose `base` is its address."""
    state = Server()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):  # noqa: N802
            state.requests.append(self.path)
            status = state.status.pop(0) if state.status else 200
            body = state.files.get(self.path)
            if body is None and status == 200:
                status = 404
            if status != 200:
                self.send_error(status)
                return
            self.send_response(200)
            if state.lengths:
                self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            keep = state.drop_after.pop(0) if state.drop_after else len(body)
            self.wfile.write(body[:keep])

        def log_message(self, *_):
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as web:
        thread = threading.Thread(target=web.serve_forever, args=(0.01,))
        thread.start()
        state.base = f"http://127.0.0.1:{web.server_port}"
        yield state
        web.shutdown()
        thread.join()
