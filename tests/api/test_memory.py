"""The budget of memory: cold meshes make room, what does not fit is refused, and nothing is lost."""
import concurrent.futures
import random

import pytest

import shapes
from conftest import check_problem, gauge

BUDGET = 12 << 20


@pytest.fixture
def small(make_daemon):
    return make_daemon("--memory-budget", BUDGET)


def test_more_meshes_than_fit_are_all_of_use(small):
    with small.client() as client:
        ids = [client.upload(shapes.sphere(0.1 * k), name=str(k))["id"] for k in range(12)]
        sizes = [mesh["memory_bytes"] for mesh in client.get("/v1/meshes").json()["meshes"]]
        assert sum(sizes) > 1.3 * BUDGET
        assert gauge(client, "mesh_evictions_total") > 0
        assert gauge(client, "memory_bytes") <= gauge(client, "memory_limit_bytes") == BUDGET
        loads = gauge(client, "mesh_loads_total")
        for k, mesh in enumerate(ids):
            result = client.hausdorff(ids[0], mesh, tolerance=0.01)["result"]
            assert result["lower"] <= 2.0 and (k > 0 or result["upper"] <= 0.04)
        assert gauge(client, "mesh_loads_total") > loads
        # The mesh that was used all the time was never dropped again.
        before = gauge(client, "mesh_loads_total")
        client.hausdorff(ids[0], ids[0], tolerance=0.5)
        assert gauge(client, "mesh_loads_total") == before


def test_many_clients_share_the_budget(small):
    """Meshes are dropped and read back while jobs, downloads and projections use them."""
    with small.client() as client:
        ids = [client.upload(shapes.sphere(0.1 * k, 30, 60), name=str(k))["id"] for k in range(24)]
    chance = random.Random(9)
    plans = [[chance.choice(ids) for _ in range(12)] for _ in range(6)]

    def work(plan):
        with small.client() as own:
            for mesh in plan:
                answer = own.post(f"/v1/meshes/{mesh}/project", content=bytes(24), headers={"Accept": "application/json"})
                assert answer.status_code == 200 and 0.9 < answer.json()["points"][0]["distance"] < 1.1
                assert own.get(f"/v1/meshes/{mesh}/content?format=stl").status_code == 200
                own.hausdorff(mesh, plan[0], tolerance=0.5)

    with concurrent.futures.ThreadPoolExecutor(6) as pool:
        list(pool.map(work, plans))
    with small.client() as client:
        assert gauge(client, "memory_bytes") <= BUDGET and gauge(client, "mesh_loads_total") > 0


def test_what_does_not_fit_is_refused_and_the_daemon_lives(small):
    with small.client() as client:
        mesh = client.upload(shapes.cube())["id"]
        content = shapes.ply_little(shapes.rough(250, seed=3))
        check_problem(client.post("/v1/meshes", content=content), 507, "out_of_memory")
        assert client.get("/v1/meshes").json()["meshes"][0]["id"] == mesh
        assert client.hausdorff(mesh, mesh)["result"]["lower"] == 0.0
        assert not any((small.folder / "data/incoming").iterdir())
        used = gauge(client, "memory_bytes")
        assert used < 1 << 20


def test_what_cannot_fit_evicts_nothing(small):
    """Counts of the header ask for more than the budget has, whatever is dropped."""
    with small.client() as client:
        meshes = [client.upload(shapes.rough(40, seed=seed))["id"] for seed in range(3)]
        before = gauge(client, "mesh_evictions_total")
        count = 2 * BUDGET // 24
        head = (f"ply\nformat binary_little_endian 1.0\nelement vertex {count}\nproperty double x\nproperty double y\n"
                "property double z\nend_header\n").encode()
        check_problem(client.post("/v1/meshes", content=head + bytes(24 * count)), 507, "out_of_memory")
        assert gauge(client, "mesh_evictions_total") == before and gauge(client, "meshes_loaded") == len(meshes)


def test_moved_vertices_are_in_the_budget(small):
    with small.client() as client:
        mesh = client.upload(shapes.cube())["id"]
        before = gauge(client, "memory_bytes")
        for kind, body in (("application/octet-stream", bytes(2 * BUDGET)), ("application/json", b" " * 2 * BUDGET)):
            moved = client.patch(f"/v1/meshes/{mesh}/vertices", content=body, headers={"Content-Type": kind})
            check_problem(moved, 507, "out_of_memory")
        assert gauge(client, "memory_bytes") == before


def test_a_job_that_needs_too_much_fails_alone(make_daemon):
    """The mesh was taken in with more memory than there is now."""
    running = make_daemon()
    with running.client() as client:
        big = client.upload(shapes.rough(120, seed=4))["id"]
        little = client.upload(shapes.cube())["id"]
    running.stop()
    running.settings = ("--memory-budget", 1 << 20)
    running.start()
    with running.client() as client:
        failed = client.hausdorff(big, little)
        assert failed["state"] == "failed" and failed["problem"]["code"] == "out_of_memory"
        check_problem(client.get(f"/v1/meshes/{big}/content"), 507, "out_of_memory")
        assert client.get(f"/v1/meshes/{big}").status_code == 200
        assert client.hausdorff(little, little)["state"] == "succeeded"
