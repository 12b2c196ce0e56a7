"""A bucket for tests: moto's S3 server in this process, which compares signatures, behind faults that a test asks for."""
import contextlib
import dataclasses
import json
import threading
import time

import boto3
import requests
from moto.moto_server.werkzeug_app import DomainDispatcherApplication, MotoRequestHandler, create_backend_app
from werkzeug.serving import make_server

NAME, REGION = "meshes", "eu-north-1"
EVERYTHING = {"Version": "2012-10-17", "Statement": [{"Effect": "Allow", "Action": "*", "Resource": "*"}]}


@dataclasses.dataclass
class Fault:
    """What happens to the next `count` requests of a method. `status`: this answer without looking at the request;
    `cut`: the answer ends after so many bytes; `spoiled`: one byte of the answer is another; `delay`: seconds before it."""
    method: str
    count: float
    status: int = 0
    cut: int | None = None
    spoiled: bool = False
    delay: float = 0.0
    taken: int = 0  # requests so far


class _Quiet(MotoRequestHandler):
    def log_request(self, *_):
        pass


class Bucket:
    """`port` speaks HTTP; `files` are the names and sizes of what lies below a prefix."""

    def __init__(self):
        self.application = DomainDispatcherApplication(create_backend_app)
        self.faults, self.lock = [], threading.Lock()
        self.server = make_server("127.0.0.1", 0, self._answer, threaded=True, request_handler=_Quiet)
        self.port = self.server.server_port
        self.url = f"http://127.0.0.1:{self.port}"
        threading.Thread(target=self.server.serve_forever, daemon=True, name="bucket").start()
        self._reset(9)
        self.keys = self._make_user()
        self.s3 = self._client("s3", *self.keys)
        self.s3.create_bucket(Bucket=NAME, CreateBucketConfiguration={"LocationConstraint": REGION})
        self._reset(0)

    def _reset(self, free):
        """From now on so many requests need no signature; each other one must have that of a user who may."""
        requests.post(f"{self.url}/moto-api/reset-auth", data=str(free), timeout=60).raise_for_status()

    def _client(self, service, key="none", secret="none"):
        return boto3.client(service, endpoint_url=self.url, region_name=REGION, aws_access_key_id=key,
                            aws_secret_access_key=secret)

    def _make_user(self):
        iam = self._client("iam")
        iam.create_user(UserName="quadmeshd")
        iam.put_user_policy(UserName="quadmeshd", PolicyName="all", PolicyDocument=json.dumps(EVERYTHING))
        key = iam.create_access_key(UserName="quadmeshd")["AccessKey"]
        return key["AccessKeyId"], key["SecretAccessKey"]

    def write_keys(self, path, secret=None):
        """A file for --blobs-keys."""
        path.write_text(f"[default]\naws_access_key_id = {self.keys[0]}\naws_secret_access_key = {secret or self.keys[1]}\n")
        return path

    def place(self, prefix, port=None, name=NAME):
        return f"s3://{name}/{prefix}?endpoint=http://127.0.0.1:{port or self.port}&region={REGION}"

    def files(self, prefix):
        listed = self.s3.list_objects_v2(Bucket=NAME, Prefix=prefix + "/").get("Contents", [])
        return {entry["Key"].rpartition("/")[2]: entry["Size"] for entry in listed}

    # ---- faults ----

    @contextlib.contextmanager
    def failing(self, method, count=float("inf"), **what):
        """Within it the next requests of a method fail."""
        fault = Fault(method, count, **what)
        with self.lock:
            self.faults.append(fault)
        try:
            yield fault
        finally:
            with self.lock:
                self.faults.remove(fault)

    def _take_fault(self, method):
        with self.lock:
            for fault in self.faults:
                if fault.method == method and fault.count > 0:
                    fault.count -= 1
                    fault.taken += 1
                    return fault
        return Fault(method, 0)

    def _answer(self, environ, start):
        fault = self._take_fault(environ["REQUEST_METHOD"])
        time.sleep(fault.delay)
        if fault.status:
            # A server that is in trouble does not read what it is sent.
            start(f"{fault.status} fault", [("Content-Length", "0"), ("Connection", "close")])
            return [b""]
        body = self.application(environ, start)
        if fault.cut is None and not fault.spoiled:
            return body
        data = bytearray(b"".join(body))
        if fault.spoiled and data:
            data[len(data) // 2] ^= 1
        return [bytes(data[:fault.cut])]

    def close(self):
        self.server.shutdown()
        self.server.server_close()
