"""A client that a generator makes of the description: it has every operation, imports, and makes a round trip."""
import importlib
import io
import pkgutil
import re
import subprocess
import sys

import pytest

import shapes
from conftest import ROOT

DESCRIPTION = ROOT / "proto/openapi.yaml"


@pytest.fixture(scope="module")
def generated(tmp_path_factory):
    """The package of openapi-python-client."""
    folder = tmp_path_factory.mktemp("generated")
    subprocess.run([sys.executable, "-m", "openapi_python_client", "generate", "--meta", "none", "--path", DESCRIPTION,
                    "--output-path", folder / "quadmeshd_client"], check=True, capture_output=True)
    sys.path.insert(0, str(folder))
    yield importlib.import_module("quadmeshd_client")
    sys.path.remove(str(folder))


def test_every_operation_is_there(generated):
    made = {module.name.rsplit(".", 1)[1] for module in pkgutil.walk_packages(generated.__path__, "quadmeshd_client.")
            if importlib.import_module(module.name) and ".api." in module.name and not module.ispkg}
    described = re.findall(r"operationId: (\w+)", DESCRIPTION.read_text())
    assert made == {re.sub("([a-z])([A-Z])", r"\1_\2", name).lower() for name in described}


def test_a_round_trip(generated, daemon):
    from quadmeshd_client import models, types
    from quadmeshd_client.api import jobs, meshes, system

    client = generated.Client(base_url=daemon.url)
    assert system.info.sync(client=client).name == "quadmeshd"
    pair = [meshes.mesh_create.sync(client=client, body=types.File(payload=io.BytesIO(shapes.obj(shapes.cube(side=side)))),
                                    name=f"cube {side}", format_=models.Format.OBJ) for side in (1, 3)]
    assert [mesh.faces.quads for mesh in pair] == [6, 6]
    request = models.HausdorffRequest(type_="hausdorff", a=pair[0].id, b=pair[1].id, tolerance=1e-9)
    job = jobs.job_create.sync(client=client, body=request, prefer="wait=30")
    assert isinstance(job, models.Job) and job.state == models.JobState.SUCCEEDED
    assert isinstance(job.result, models.HausdorffResult)
    # From a corner of the larger cube, whose edges are 6, to that of the smaller one, whose edges are 2.
    assert job.result.lower <= 12 ** 0.5 <= job.result.upper and job.result.converged
    assert jobs.job_get.sync(job.id, client=client).result == job.result
    listed = meshes.mesh_list.sync(client=client, limit=1000)
    assert {mesh.id for mesh in pair} <= {mesh.id for mesh in listed.meshes}
    refused = jobs.job_create.sync(client=client, body=models.SelfCollisionRequest(type_="self_collision", mesh="m_none"))
    assert isinstance(refused, models.Problem) and refused.code == models.ProblemCode.MESH_NOT_FOUND
    for mesh in pair:
        assert meshes.mesh_delete.sync_detailed(mesh.id, client=client).status_code == 204
