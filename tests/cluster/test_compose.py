"""The primary of docker/compose.cluster.yaml comes up as its image makes it: a database first, then its standby."""
import os
import pathlib
import subprocess
import tempfile

import pytest
import yaml

from api_conftest import ROOT
from postgres import NAME, Instance, server_user


@pytest.fixture
def folder():
    """A folder that the user of the server may reach."""
    with tempfile.TemporaryDirectory(prefix="quadmeshd-compose-") as made:
        yield pathlib.Path(made)


def test_the_primary_of_compose_does_not_wait_for_a_standby_before_there_is_one(folder):
    service = yaml.safe_load((ROOT / "docker/compose.cluster.yaml").read_text())["services"]["primary"]
    settings = dict(word.split("=", 1) for word in service["command"] if "=" in word)
    (script,) = [volume.split(":")[0] for volume in service["volumes"] if "initdb.d" in volume]
    if owner := server_user():
        os.chown(folder, owner["user"], owner["group"])
    primary = Instance(folder / "primary")
    primary.initialize()
    primary.start(**settings)  # what the image does before the first start
    try:
        primary.query(f"CREATE DATABASE {NAME}", database="postgres")
        subprocess.run(["bash", (ROOT / "docker" / script).resolve()], check=True, env={**os.environ, "PGDATA": primary.folder})
        primary.stop()
        primary.start(**settings)
        assert primary.query("SHOW synchronous_standby_names") == [["ANY 1 (standby)"]]
        assert "host replication quadmeshd" in (primary.folder / "pg_hba.conf").read_text()
    finally:
        primary.stop()
