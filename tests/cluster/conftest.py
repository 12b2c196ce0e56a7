"""The daemon of tests/api, several of them on one database.

QM_TEST_LONG=1 runs the long forms. QM_TEST_SEED moves what is left to chance; a failure shows the seed.
"""
import importlib.util
import pathlib
import sys

import pytest

API = pathlib.Path(__file__).parent.parent / "api"
sys.path.append(str(API))
spec = importlib.util.spec_from_file_location("api_conftest", API / "conftest.py")
api_conftest = importlib.util.module_from_spec(spec)
sys.modules["api_conftest"] = api_conftest
spec.loader.exec_module(api_conftest)
# Modules of tests/api import these from `conftest`, which is this one here.
globals().update({name: value for name, value in vars(api_conftest).items() if not name.startswith(("__", "pytest_"))})

# What has points of failure is a build for tests: QM_BUILD=build/asan.
collect_ignore = [] if b"QM_FAILPOINT" in (api_conftest.BUILD / "quadmeshd").read_bytes() else ["test_points.py"]

from cluster import Cluster  # noqa: E402 (needs api_conftest)


@pytest.fixture
def make_cluster(tmp_path):
    """Clusters of a test's own, closed at its end: make_cluster(count, ...)."""
    made = []

    def make(*arguments, **options):
        made.append(Cluster(tmp_path / f"cluster{len(made)}", *arguments, **options))
        return made[-1]

    yield make
    for cluster in made:
        cluster.close()


@pytest.fixture(scope="session")
def shared_cluster(tmp_path_factory):
    with Cluster(tmp_path_factory.mktemp("shared") / "cluster", 3, standby=True) as made:
        yield made


@pytest.fixture
def cluster(shared_cluster):
    """Three nodes, a primary and a synchronous standby, for tests that break what `mend` makes whole."""
    yield shared_cluster
    shared_cluster.mend()
