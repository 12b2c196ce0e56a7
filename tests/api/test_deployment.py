"""What docker/ holds, tried with the programs that read it: nginx with TLS in front of a daemon, systemd's own checks."""
import json
import os
import re
import ssl
import subprocess
import time

import httpx
import pytest
import yaml

import shapes
from conftest import BUILD, PATIENCE, ROOT, SLOW, check_problem
from ports import claim_port

TOKEN = "t" * 32


@pytest.fixture(scope="module")
def guarded(tmp_path_factory):
    from conftest import Daemon
    folder = tmp_path_factory.mktemp("behind")
    (folder / "tokens").write_text(f"write {TOKEN}\n")
    running = Daemon(folder, "--token-file", folder / "tokens")
    yield running
    assert running.stop() == 0


@pytest.fixture(scope="module")
def nginx(guarded, tmp_path_factory):
    """The configuration as it is, but for names, ports and paths of this machine."""
    folder = tmp_path_factory.mktemp("nginx")
    key, certificate, port = folder / "key.pem", folder / "cert.pem", claim_port()
    subprocess.run(["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=localhost",
                    "-addext", "subjectAltName=DNS:localhost", "-keyout", key, "-out", certificate], check=True,
                   capture_output=True)
    site = (ROOT / "docker/nginx.conf").read_text()
    for old, new in (("server quadmeshd:7878;", f"server 127.0.0.1:{guarded.port};"),
                     ("listen 443 ssl;", f"listen 127.0.0.1:{port} ssl;"), ("/run/secrets/cert.pem", str(certificate)),
                     ("/run/secrets/key.pem", str(key))):
        assert site.count(old) == 1, old
        site = site.replace(old, new)
    (folder / "site.conf").write_text(site)
    temporary = "".join(f"{name}_temp_path {folder}/{name};\n" for name in
                        ("client_body", "proxy", "fastcgi", "uwsgi", "scgi"))
    (folder / "nginx.conf").write_text(
        f"daemon off; pid {folder}/pid; error_log {folder}/error.log; events {{}}\n"
        f"http {{ access_log off; {temporary} include {folder}/site.conf; }}\n")
    program = next(path for path in ("/usr/sbin/nginx", "/usr/bin/nginx") if os.path.exists(path))
    command = [program, "-p", folder, "-e", folder / "error.log", "-c", folder / "nginx.conf"]
    subprocess.run([*command, "-t"], check=True, capture_output=True)
    process = subprocess.Popen(command)
    client = httpx.Client(base_url=f"https://localhost:{port}", verify=ssl.create_default_context(cafile=certificate),
                          headers={"Authorization": f"Bearer {TOKEN}"}, timeout=PATIENCE)
    end = time.monotonic() + PATIENCE
    while True:
        try:
            client.get("/healthz")
            break
        except httpx.TransportError:
            assert process.poll() is None and time.monotonic() < end
            time.sleep(0.02)
    yield client
    client.close()
    process.terminate()
    assert process.wait(PATIENCE) == 0


def upload(client, content):
    reply = client.post("/v1/meshes", content=content)
    assert reply.status_code in (200, 201), reply.text
    return reply.json()["id"]


def test_calls_pass_through_tls(nginx):
    assert nginx.get("/v1/info").json()["name"] == "quadmeshd"
    bare = httpx.Client(base_url=nginx.base_url, verify=False)
    check_problem(bare.get("/v1/info"), 401, "unauthorized")
    mesh = upload(nginx, shapes.obj(shapes.cube(side=3.25)))
    reply = nginx.get(f"/v1/meshes/{mesh}", headers={"X-Request-Id": "through"})
    assert reply.headers["x-request-id"] == "through" and "etag" in reply.headers
    assert reply.headers["strict-transport-security"]
    content = nginx.get(f"/v1/meshes/{mesh}/content?format=obj")
    assert content.status_code == 200 and content.text.count("\nf ") == 6
    assert nginx.delete(f"/v1/meshes/{mesh}").status_code == 204


def test_metrics_stay_inside(nginx):
    assert nginx.get("/metrics").status_code == 404


def test_uploads_may_be_larger_than_nginx_likes(nginx):
    """Its own limit is a megabyte; chunked, too."""
    content = shapes.ply_little(shapes.rough(250, seed=8))
    assert len(content) > 2 << 20
    mesh = upload(nginx, content)
    assert upload(nginx, (content[i:i + 65536] for i in range(0, len(content), 65536))) == mesh


def test_events_come_one_by_one(nginx, slow_files):
    pair = [upload(nginx, content) for content in slow_files]
    request = {"type": "hausdorff", "a": pair[0], "b": pair[1], "deadline_ms": 2000, **SLOW}
    for accept in ("application/x-ndjson", "text/event-stream"):
        start, seen = time.monotonic(), []
        headers = {"Accept": accept, "Cache-Control": "no-cache"}
        with nginx.stream("POST", "/v1/jobs", json=request, headers=headers) as reply:
            assert reply.headers["content-type"].startswith(accept)
            for line in reply.iter_lines():
                if '"bounds"' in line or '"result"' in line:
                    seen.append(time.monotonic() - start)
        # Held back by a proxy they would all come at the end.
        assert len(seen) > 3 and seen[-1] - seen[0] > 0.5


def test_who_hangs_up_at_nginx_ends_the_job(nginx, slow_files):
    pair = [upload(nginx, content) for content in slow_files]
    headers = {"Accept": "application/x-ndjson", "Cache-Control": "no-cache"}
    with nginx.stream("POST", "/v1/jobs", json={"type": "hausdorff", "a": pair[0], "b": pair[1], **SLOW},
                      headers=headers) as reply:
        path = reply.headers["location"]
        next(reply.iter_lines())
    end = time.monotonic() + PATIENCE
    while nginx.get(path).json()["state"] == "running":
        assert time.monotonic() < end
        time.sleep(0.05)
    assert nginx.get(path).json()["state"] == "canceled"


@pytest.mark.parametrize("has_tokens", [False, True])
def test_the_unit_is_tight(tmp_path, has_tokens):
    text = (ROOT / "docker/quadmeshd.service").read_text()
    unit = tmp_path / "quadmeshd.service"
    if has_tokens:
        assert text.count("\n#LoadCredential=") == text.count("\n#Environment=") == 1
        text = text.replace("\n#LoadCredential=", "\nLoadCredential=").replace("\n#Environment=", "\nEnvironment=")
    unit.write_text(text.replace("/usr/local/bin/quadmeshd", str(BUILD / "quadmeshd")))
    verified = subprocess.run(["systemd-analyze", "verify", unit], capture_output=True, text=True)
    assert verified.returncode == 0 and "quadmeshd.service" not in verified.stderr, verified.stderr
    rated = subprocess.run(["systemd-analyze", "security", "--offline=true", "--threshold=20", unit],
                           capture_output=True, text=True)
    # Of 100, where 0 is closest; a unit without any of these settings has 96.
    assert rated.returncode == 0, rated.stdout[-300:]


def test_compose_and_prometheus_agree_with_the_image():
    image = (ROOT / "docker/Dockerfile").read_text()
    compose = yaml.safe_load((ROOT / "docker/compose.yaml").read_text())
    scrape = yaml.safe_load((ROOT / "docker/prometheus.yml").read_text())
    port = re.search(r"QUADMESHD_HEALTH_PORT=(\d+)", image).group(1)
    assert scrape["scrape_configs"][0]["static_configs"][0]["targets"] == [f"quadmeshd:{port}"]
    assert f"/dev/tcp/127.0.0.1/{port}" in image and "USER quadmeshd" in image
    assert re.search(r"EXPOSE (.*)", image).group(1).split() == ["7878", port]
    # What the image says is what the daemon takes.
    names = set(re.findall(r"QUADMESHD_([A-Z_]+)=", image))
    known = subprocess.run([BUILD / "quadmeshd", "--print-config"], capture_output=True, text=True).stdout
    for name in names:
        assert re.search(f"^{name.lower().replace('_', '-')} = ", known, re.M), name
    command = json.loads(re.search(r"^CMD (\[.*\])$", image, re.M).group(1))
    assert command[:2] == ["--listen", "0.0.0.0"] and command[2] == "--token-file"
    secret = command[3].removeprefix("/run/secrets/")
    assert compose["services"]["quadmeshd"]["secrets"] == [secret] and secret in compose["secrets"]
    assert set(compose["services"]["nginx"]["secrets"]) <= set(compose["secrets"])


def test_the_unit_of_one_of_several_is_tight(tmp_path):
    text = (ROOT / "docker/quadmeshd@.service").read_text()
    unit = tmp_path / "quadmeshd@n1.service"
    unit.write_text(text.replace("/usr/local/bin/quadmeshd", str(BUILD / "quadmeshd")))
    verified = subprocess.run(["systemd-analyze", "verify", unit], capture_output=True, text=True)
    assert verified.returncode == 0 and "quadmeshd@" not in verified.stderr, verified.stderr
    rated = subprocess.run(["systemd-analyze", "security", "--offline=true", "--threshold=20", unit],
                           capture_output=True, text=True)
    assert rated.returncode == 0, rated.stdout[-300:]
    # Both units say the same but for who they are.
    alone = (ROOT / "docker/quadmeshd.service").read_text().splitlines()
    several = text.splitlines()
    assert len(set(several) ^ set(alone)) < 30


def test_the_compose_of_several_daemons_agrees_with_itself(tmp_path):
    compose = yaml.safe_load((ROOT / "docker/compose.cluster.yaml").read_text())
    scrape = yaml.safe_load((ROOT / "docker/prometheus.cluster.yml").read_text())
    site = (ROOT / "docker/nginx.cluster.conf").read_text()
    services = compose["services"]
    daemons = [name for name, service in services.items() if "command" in service and "--store-file" in service["command"]]
    assert daemons == ["n1", "n2", "n3"]
    assert scrape["scrape_configs"][0]["static_configs"][0]["targets"] == [f"{name}:7880" for name in daemons]
    assert set(re.findall(r"server (\w+):7878;", site)) == set(daemons)
    for service in services.values():
        assert set(service.get("secrets", [])) <= set(compose["secrets"])
        for volume in service.get("volumes", []):
            source = volume.split(":")[0]
            assert source in compose["volumes"] or (ROOT / "docker" / source).exists(), source
    for name in daemons:
        assert services[name]["hostname"] == name  # a restart keeps its name, and with that its meshes
    known = subprocess.run([BUILD / "quadmeshd", "--print-config"], capture_output=True, text=True).stdout
    for flag in services["n1"]["command"]:
        if flag.startswith("--"):
            assert re.search(f"^{flag[2:]} = ", known, re.M), flag


def test_the_nginx_of_several_daemons_is_valid(tmp_path):
    key, certificate = tmp_path / "key.pem", tmp_path / "cert.pem"
    subprocess.run(["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=localhost",
                    "-keyout", key, "-out", certificate], check=True, capture_output=True)
    site = (ROOT / "docker/nginx.cluster.conf").read_text()
    for old, new in (("server n", "server 127.0.0."), ("listen 443 ssl;", f"listen 127.0.0.1:{claim_port()} ssl;"),
                     ("/run/secrets/cert.pem", str(certificate)), ("/run/secrets/key.pem", str(key))):
        assert old in site
        site = site.replace(old, new)
    (tmp_path / "site.conf").write_text(site)
    (tmp_path / "nginx.conf").write_text(f"pid {tmp_path}/pid; error_log {tmp_path}/error.log; events {{}}\n"
                                         f"http {{ access_log off; include {tmp_path}/site.conf; }}\n")
    program = next(path for path in ("/usr/sbin/nginx", "/usr/bin/nginx") if os.path.exists(path))
    tested = subprocess.run([program, "-p", tmp_path, "-e", tmp_path / "error.log", "-c", tmp_path / "nginx.conf", "-t"],
                            capture_output=True, text=True)
    assert tested.returncode == 0, tested.stderr


CHART = ROOT / "docker/helm/quadmeshd"


def known_settings():
    """The names of all settings."""
    shown = subprocess.run([BUILD / "quadmeshd", "--print-config"], capture_output=True, text=True, check=True).stdout
    return {*re.findall(r"^([a-z-]+) =", shown, re.M), "config"}


def as_setting(variable):
    return variable.removeprefix("QUADMESHD_").lower().replace("_", "-")


def test_files_name_settings_that_there_are():
    """In whatever form: as an environment variable, as a flag of the daemon."""
    known, tasks = known_settings(), {"store", "status", "check", "backup", "restore"}
    for path in sorted((ROOT / "docker").rglob("*")):
        if not path.is_file() or path.name == "install-packages.sh":
            continue
        text = path.read_text()
        for variable in re.findall(r"\bQUADMESHD_[A-Z_]+\b", text):
            assert as_setting(variable) in known, (path, variable)
        words = re.findall(r'"--([a-z-]+)"', text) if path.suffix == ".yaml" else \
            [word for line in re.findall(r"^ExecStart=.*quadmeshd (.*)$", text, re.M) for word in re.findall(r"--([a-z-]+)", line)]
        for flag in words:
            assert flag in known | tasks, (path, flag)


def render(template, values):
    """Documents of a template, with values put in where they are named, and a word where a function gives one."""
    def value_of(match):
        found = values
        for name in match.group(1).split("."):
            found = found[name]
        return str(found)
    lines = [line for line in template.splitlines() if not re.fullmatch(r"\s*\{\{-? ?(range|end|with|if).*\}\}", line)]
    text = re.sub(r"\{\{ \.Values\.([\w.]+) \}\}", value_of, "\n".join(lines))
    return list(yaml.safe_load_all(re.sub(r"\{\{.*?\}\}", "7", text)))


def test_the_chart_agrees_with_the_image_and_the_contract():
    values = yaml.safe_load((CHART / "values.yaml").read_text())
    image = (ROOT / "docker/Dockerfile").read_text()
    contract = yaml.safe_load((ROOT / "proto/openapi.yaml").read_text())
    daemons, _ = render((CHART / "templates/daemons.yaml").read_text(), values)
    services = render((CHART / "templates/service.yaml").read_text(), values)
    (container,) = daemons["spec"]["template"]["spec"]["containers"]
    ports = {port["name"]: port["containerPort"] for port in container["ports"]}
    assert [str(ports["http"]), str(ports["health"])] == re.search(r"EXPOSE (.*)", image).group(1).split()
    assert f"QUADMESHD_HEALTH_PORT={ports['health']}" in image and "QUADMESHD_HEALTH_LISTEN=0.0.0.0" in image
    for probe in ("readinessProbe", "livenessProbe"):
        asked = container[probe]["httpGet"]
        assert asked["port"] == "health" and "get" in contract["paths"][asked["path"]]
    for service in services:
        assert {port["targetPort"] for port in service["spec"]["ports"]} <= set(ports)
    pod = daemons["spec"]["template"]
    assert pod["metadata"]["annotations"]["prometheus.io/port"] == str(ports["health"])
    assert f"--uid {pod['spec']['securityContext']['runAsUser']} " in image
    # The folder of the image is the cache, and every file that an argument names is in a volume.
    mounts = {mount["mountPath"] for mount in container["volumeMounts"]}
    assert re.search(r"QUADMESHD_DATA_DIR=(\S+)", image).group(1) in mounts
    for argument in container["args"]:
        if argument.startswith("/"):
            assert os.path.dirname(argument) in mounts, argument
    volumes = {volume["name"] for volume in pod["spec"]["volumes"]} | {
        claim["metadata"]["name"] for claim in daemons["spec"]["volumeClaimTemplates"]}
    assert {mount["name"] for mount in container["volumeMounts"]} == volumes
    # Each value that a template names is there, and each that is there is used.
    text = "".join(path.read_text() for path in (CHART / "templates").iterdir())
    named = {name.split(".")[0] for name in re.findall(r"\.Values\.([\w.]+)", text)}
    assert named == set(values)
    chart = yaml.safe_load((CHART / "Chart.yaml").read_text())
    version = subprocess.run([BUILD / "quadmeshd", "--version"], capture_output=True, text=True, check=True).stdout
    assert chart["appVersion"] in version and (CHART / "templates/_helpers.tpl").exists()
    assert daemons["spec"]["serviceName"] == services[1]["metadata"]["name"]
