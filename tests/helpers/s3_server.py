"""A small S3 server on the loopback: the calls by which a client lists a bucket and reads from it.

ListObjectsV2 with prefix and delimiter, HeadObject and GetObject, whole or a range of bytes. Every
other request is refused as not implemented. Its objects are bytes in a dict, by bucket and key.
"""

import hashlib
import re
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from urllib.parse import parse_qs, unquote, urlsplit
from xml.etree.ElementTree import Element, SubElement, tostring

Objects = dict[tuple[str, str], bytes]
_DATE, _MODIFIED = "2026-01-02T03:04:05.000Z", "Fri, 02 Jan 2026 03:04:05 GMT"


class _Server(ThreadingHTTPServer):
    objects: Objects


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: _Server

    def do_GET(self) -> None:
        url = urlsplit(self.path)
        bucket, _, key = unquote(url.path).strip("/").partition("/")
        if key:
            self._object(bucket, key)
        elif (query := parse_qs(url.query)).get("list-type") == ["2"]:
            self._listing(bucket, query.get("prefix", [""])[0], query.get("delimiter", [""])[0])
        else:
            self._error(501, "NotImplemented")

    do_HEAD = do_GET

    def _listing(self, bucket: str, prefix: str, delimiter: str) -> None:
        if bucket not in {name for name, _ in self.server.objects}:
            self._error(404, "NoSuchBucket")
            return
        document, folders = Element("ListBucketResult"), set()
        for (name, key), content in sorted(self.server.objects.items()):
            if name != bucket or not key.startswith(prefix):
                continue
            folder, separator, _ = key[len(prefix) :].partition(delimiter or "\0")
            if separator:
                folders.add(prefix + folder + separator)
                continue
            entry = SubElement(document, "Contents")
            for tag, text in (("Key", key), ("LastModified", _DATE), ("Size", str(len(content)))):
                SubElement(entry, tag).text = text
        for folder in sorted(folders):
            SubElement(SubElement(document, "CommonPrefixes"), "Prefix").text = folder
        SubElement(document, "IsTruncated").text = "false"
        self._answer(200, tostring(document, "utf-8"), {"Content-Type": "application/xml"})

    def _object(self, bucket: str, key: str) -> None:
        content = self.server.objects.get((bucket, key))
        if content is None:
            self._error(404, "NoSuchKey")
            return
        tag = f'"{hashlib.sha256(content).hexdigest()}"'
        headers = {"ETag": tag, "Last-Modified": _MODIFIED, "Accept-Ranges": "bytes"}
        wanted = re.fullmatch(r"bytes=(\d+)-(\d*)", self.headers.get("Range", ""))
        if wanted is None:
            self._answer(200, content, headers)
            return
        start, stop = int(wanted[1]), min(int(wanted[2] or len(content)) + 1, len(content))
        headers["Content-Range"] = f"bytes {start}-{stop - 1}/{len(content)}"
        self._answer(206, content[start:stop], headers)

    def _error(self, status: int, code: str) -> None:
        document = Element("Error")
        SubElement(document, "Code").text = code
        self._answer(status, tostring(document, "utf-8"), {"Content-Type": "application/xml"})

    def _answer(self, status: int, body: bytes, headers: dict[str, str]) -> None:
        self.send_response(status)
        for name, value in (*headers.items(), ("Content-Length", str(len(body)))):
            self.send_header(name, value)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        """Prints nothing."""


@contextmanager
def serving(objects: Objects) -> Iterator[str]:
    """The address of a server of these objects."""
    server = _Server(("127.0.0.1", 0), _Handler)
    server.objects = objects
    thread = Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
