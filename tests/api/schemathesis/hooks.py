"""Hooks for schemathesis: ids of what is really there, files that are meshes, and lines of JSON."""
import json
import os
import random
import re

import schemathesis

MESHES = os.environ["QM_MESHES"].split(",")
JOBS = os.environ["QM_JOBS"].split(",")
ID = re.compile(r"[a-zA-Z0-9_.-]{1,39}")
FILES = [b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", b"OFF\n4 1 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n",
         b"0 0 0\n1 2 3\n", b"v 1 2\n", b"f 1 2 3\n", b"ply\n", b"DRACO\2\2", b"glTF\2\0\0\0", b"", b"\xff\0\xfe"]
chance = random.Random(int(os.environ["QM_SEED"]))


def is_id(value):
    return isinstance(value, str) and ID.fullmatch(value) is not None


@schemathesis.hook
def map_path_parameters(context, path_parameters):
    """Most ids name objects that exist: random strings of the pattern never do."""
    if path_parameters and is_id(path_parameters.get("id")) and chance.random() < 0.8:
        path_parameters["id"] = chance.choice(JOBS if "/jobs/" in context.operation.path else MESHES)
    return path_parameters


def lengthen_deadline(fields):
    """Most deadlines leave time for an answer: a random one is over before the start."""
    if isinstance(fields, dict) and isinstance(fields.get("deadline_ms"), (int, float)) and chance.random() < 0.8:
        fields["deadline_ms"] = 10000.0
    return fields


@schemathesis.hook
def map_query(context, query):
    return lengthen_deadline(query)


@schemathesis.hook
def map_body(context, body):
    path = context.operation.path
    lengthen_deadline(body)
    if path == "/v1/jobs" and isinstance(body, dict):
        for name in ("a", "b", "mesh"):
            if is_id(body.get(name)) and chance.random() < 0.9:
                body[name] = chance.choice(MESHES)
        if isinstance(body.get("meshes"), list) and chance.random() < 0.9:
            body["meshes"] = [chance.choice(MESHES) if is_id(one) else one for one in body["meshes"]]
        for place in (body, body.get("engine")):
            if isinstance(place, dict) and isinstance(place.get("pieces"), (int, float)) and place["pieces"] > 10000:
                place["pieces"] = 10000
    if path == "/v1/layouts" and isinstance(body, dict):
        for name in ("quad_count", "patches"):  # the checked build takes a minute for the most that is allowed
            if isinstance(body.get(name), (int, float)) and body[name] > 3000:
                body[name] = 3000
    return body


@schemathesis.serializer("model/obj", "application/x-ply", "model/stl", "application/x-off", "model/gltf-binary",
                         "application/x-draco", "text/x-xyz", "application/octet-stream")
def serialize_file(context, value):
    if isinstance(value, bytes):
        return value
    if "/project" in context.case.operation.path:
        return bytes(24 * chance.randrange(4)) if chance.random() < 0.7 else json.dumps(value).encode()
    return chance.choice(FILES) if chance.random() < 0.8 else json.dumps(value).encode()


@schemathesis.serializer("application/x-ndjson")
def serialize_lines(context, value):
    line = json.dumps({"key": 1, "type": "project", "mesh": chance.choice(MESHES), "points": [[0, 0, 3]]})
    return "\n".join([line, value if isinstance(value, str) else json.dumps(value), line]).encode("utf-8", "replace")


@schemathesis.deserializer("application/x-ndjson")
def deserialize_lines(context, response):
    """The schema is that of a line: the first one stands for all."""
    first = response.content.split(b"\n", 1)[0]
    return json.loads(first) if first else {"event": "heartbeat", "seq": 0}
