"""Local server of the model hub's protocol, for huggingface_hub's client."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

COMMIT = "a" * 40


class HubServer:
    """Repositories as dictionaries, and everything that was asked.

    Attributes:
        repos: Files of each repository by revision: ``repos[NAME][REVISION][FILE]``.
        gated: Repositories whose terms have to be accepted.
        private: Repositories that are shown to those with the token ``secret``.
        asked: Method, path and ``Range`` of each request.
        closed: Whether the server is away.
        cut: Bytes after which the next download is cut off; 0 for none.
    """

    def __init__(self) -> None:
        self.repos: dict[str, dict[str, dict[str, bytes]]] = {}
        self.gated: set[str] = set()
        self.private: set[str] = set()
        self.asked: list[tuple[str, str, str]] = []
        self.cut = 0
        self.closed = False
        self.server = ThreadingHTTPServer(("127.0.0.1", 0), _handler(self))
        self.url = f"http://127.0.0.1:{self.server.server_port}"
        # another host, as the hub's storage is
        self.storage = f"http://localhost:{self.server.server_port}"
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    def close(self) -> None:
        self.closed = True
        self.server.shutdown()
        self.server.server_close()


def _handler(hub: HubServer) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def log_message(self, *_: Any) -> None:
            pass

        def answer(self, status: int, body: bytes = b"", **headers: str) -> None:
            if hub.closed:  # a connection that is kept alive outlives the server
                self.close_connection = True
                return
            self.send_response(status)
            for key, value in headers.items():
                self.send_header(key.replace("_", "-"), value)
            if "Content_Length" not in headers:
                self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            if self.command != "HEAD":
                self.wfile.write(body)

        def refused(self, repo: str) -> bool:
            token = self.headers.get("Authorization") == "Bearer secret"
            if repo in hub.gated and not token:
                self.answer(401, X_Error_Code="GatedRepo", X_Error_Message="Access is restricted")
            elif repo not in hub.repos or (repo in hub.private and not token):
                self.answer(401, X_Error_Code="RepoNotFound", X_Error_Message="Not found")
            else:
                return False
            return True

        def do_HEAD(self) -> None:
            self.do_GET()

        def do_GET(self) -> None:
            wanted = self.headers.get("Range", "")
            hub.asked.append((self.command, self.path, wanted))
            if self.path.startswith("/blob/"):
                return self.blob(self.path.removeprefix("/blob/"), wanted)
            match = re.fullmatch(r"/([^/]+/[^/]+)/resolve/([^/]+)/(.+)", self.path)
            if not match:
                return self.answer(404)
            repo, revision, file = match.groups()
            if self.refused(repo):
                return None
            revision = "main" if revision == COMMIT else revision
            if revision not in hub.repos[repo]:
                return self.answer(404, X_Error_Code="RevisionNotFound")
            files = hub.repos[repo][revision]
            if file not in files:
                return self.answer(404, X_Error_Code="EntryNotFound", X_Repo_Commit=COMMIT)
            digest = hashlib.sha256(files[file]).hexdigest()
            commit = COMMIT if revision == "main" else (revision * 40)[:40]
            # large files lie elsewhere: a redirect, as the hub's to its storage
            return self.answer(
                302,
                Location=f"{hub.storage}/blob/{digest}",
                X_Repo_Commit=commit,
                X_Linked_Etag=f'"{digest}"',
                X_Linked_Size=str(len(files[file])),
            )

        def blob(self, digest: str, wanted: str) -> None:
            every = (
                body
                for revisions in hub.repos.values()
                for files in revisions.values()
                for body in files.values()
            )
            body = next(x for x in every if hashlib.sha256(x).hexdigest() == digest)
            first = int(wanted.removeprefix("bytes=").partition("-")[0] or 0) if wanted else 0
            part, status = body[first:], 206 if wanted else 200
            extra = {"Content_Range": f"bytes {first}-{len(body) - 1}/{len(body)}"} if first else {}
            if hub.cut and self.command == "GET":
                cut, hub.cut = hub.cut, 0
                self.answer(status, part[:cut], Content_Length=str(len(part)), **extra)
                self.close_connection = True
                return
            self.answer(status, part, **extra)

        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
            hub.asked.append(("POST", self.path, ""))
            if self.headers.get("Authorization") != "Bearer secret":
                return self.answer(401, b'{"error": "Invalid credentials"}')
            if self.path == "/api/repos/create":
                facts = json.loads(body)
                owner = facts.get("organization") or "me"
                name = f"{owner}/{facts['name']}"
                known = name in hub.repos
                hub.repos.setdefault(name, {}).setdefault("main", {})
                if facts.get("private") or facts.get("visibility") == "private":
                    hub.private.add(name)
                said = {"url": f"{hub.url}/{name}", "error": "exists"}
                return self.answer(409 if known else 200, json.dumps(said).encode())
            match = re.fullmatch(r"/api/models/([^/]+/[^/]+)/(preupload|commit)/(\w+)", self.path)
            if not match:
                return self.answer(200, b"{}")
            repo, kind, revision = match.groups()
            if kind == "preupload":
                files = json.loads(body)["files"]
                modes = [
                    {"path": x["path"], "uploadMode": "regular", "shouldIgnore": False, "oid": None}
                    for x in files
                ]
                return self.answer(200, json.dumps({"files": modes}).encode())
            for line in body.splitlines():
                entry = json.loads(line)
                if entry["key"] == "file":
                    content = base64.b64decode(entry["value"]["content"])
                    hub.repos[repo][revision][entry["value"]["path"]] = content
            said = {"commitUrl": f"{hub.url}/{repo}/commit/{COMMIT}", "commitOid": COMMIT}
            return self.answer(200, json.dumps(said).encode())

    return Handler
