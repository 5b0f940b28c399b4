"""The image, its filter of system calls and how it is run. No container runtime is needed: the filter is put
in force for real, and what the Dockerfile's instructions promise is read from it."""

from __future__ import annotations

import contextlib
import http.server
import json
import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer.main
import yaml
from tests import seccomp, unprivileged

from webgym import cli
from webgym.browser.find import find_browser

ROOT = Path(__file__).resolve().parent.parent
DEPLOY = ROOT / "deploy"
PROFILE: dict[str, Any] = json.loads((DEPLOY / "seccomp.json").read_text())
COMPOSE: dict[str, Any] = yaml.safe_load((DEPLOY / "compose.yaml").read_text())["services"]["webgym"]

# What gives a way out of a container, or into the kernel, that no browser needs.
DANGEROUS = """
    acct add_key adjtimex bpf clock_adjtime clock_settime delete_module fanotify_init finit_module fsconfig
    fsmount fsopen fspick init_module io_uring_enter io_uring_register io_uring_setup ioperm iopl kcmp
    kexec_file_load kexec_load keyctl lookup_dcookie mount mount_setattr move_mount move_pages
    name_to_handle_at nfsservctl open_by_handle_at open_tree perf_event_open personality pivot_root
    process_vm_readv process_vm_writev ptrace quotactl reboot request_key setdomainname sethostname setns
    settimeofday swapoff swapon sysfs syslog umount umount2 userfaultfd vhangup
""".split()


# --- the image ----------------------------------------------------------------------------------------


def instructions() -> list[tuple[str, str]]:
    """The Dockerfile's instructions: (word, the rest), continued lines joined."""
    lines = [line for line in (DEPLOY / "Dockerfile").read_text().splitlines() if not line.startswith("#")]
    joined = re.sub(r"\\\n\s*", " ", "\n".join(lines))
    parts = [line.partition(" ") for line in joined.splitlines() if line]
    return [(word, rest.strip()) for word, _, rest in parts]


def last_stage() -> dict[str, str]:
    """The instructions that make the image itself, the last of each kind."""
    every = instructions()
    start = max(number for number, (word, _) in enumerate(every) if word == "FROM")
    return dict(every[start:])


def test_it_does_not_run_as_root_and_has_an_init() -> None:
    made = last_stage()
    user, _, group = made["USER"].partition(":")
    assert int(user) >= 1000
    assert int(group) >= 1000
    assert f"--uid {user} " in made["RUN"]
    assert json.loads(made["ENTRYPOINT"])[0] == "tini"
    assert " tini " in made["RUN"]
    assert "chmod a-s" in made["RUN"]


def test_what_it_runs_is_a_command_of_ours() -> None:
    for command in (json.loads(last_stage()["CMD"]), COMPOSE["command"]):
        group: Any = typer.main.get_command(cli.build(command[0]))
        context = group.commands[command[0]].make_context(command[0], list(command[1:]))
        assert context.params["host"] == "0.0.0.0"
        assert context.params["port"] == int(last_stage()["EXPOSE"])


def test_nothing_but_sources_goes_in() -> None:
    lines = [line for line in (ROOT / ".dockerignore").read_text().splitlines() if not line.startswith("#")]
    assert lines[0] == "*", "all that is not named stays out"
    let_in = {line[1:] for line in lines if line.startswith("!")}
    for word, rest in instructions():
        if word == "COPY" and "--from" not in rest:
            for source in rest.split()[:-1]:
                assert source in let_in
                assert (ROOT / source).exists()
        if word in ("ENV", "ARG"):
            assert not re.search(r"token|secret|password|key", rest, re.IGNORECASE)


@contextlib.contextmanager
def answering(status: int) -> Iterator[int]:
    class Answer(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            assert self.path == "/healthz"
            self.send_response(status)
            self.send_header("content-length", "0")
            self.end_headers()

        def log_message(self, *_: object) -> None:
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Answer) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server.server_port
        server.shutdown()
        thread.join()


@pytest.mark.parametrize(("status", "healthy"), [(200, True), (503, False), (None, False)])
def test_the_health_check_tells_health(status: int | None, healthy: bool) -> None:
    check = last_stage()["HEALTHCHECK"]
    _, flag, code = json.loads(check[check.index("[") :])
    with answering(status or 200) as port:
        pass  # nobody answers there any more
    with answering(status) if status else contextlib.nullcontext(port) as port:
        code = code.replace(last_stage()["EXPOSE"], str(port))
        answer = subprocess.run([sys.executable, flag, code], capture_output=True, timeout=30, check=False)
    assert (answer.returncode == 0) is healthy


# --- how it is run ------------------------------------------------------------------------------------


def test_compose_confines_it() -> None:
    assert COMPOSE["read_only"] is True
    assert COMPOSE["cap_drop"] == ["ALL"]
    assert "no-new-privileges:true" in COMPOSE["security_opt"]
    [profile] = [one.partition(":")[2] for one in COMPOSE["security_opt"] if one.startswith("seccomp:")]
    assert (DEPLOY / profile).is_file()
    assert all(address.startswith("127.0.0.1:") for address in COMPOSE["ports"])
    assert re.fullmatch(r"\$\{WEBGYM_TOKEN:\?.+\}", COMPOSE["environment"]["WEBGYM_TOKEN"])
    [temporary] = COMPOSE["tmpfs"]
    assert temporary.startswith("/tmp:")
    slots = int(COMPOSE["command"][-1])
    assert COMPOSE["pids_limit"] >= 100 * slots
    assert COMPOSE["mem_limit"] == "4g"


# --- on Kubernetes ------------------------------------------------------------------------------------

KUBERNETES: dict[str, dict[str, Any]] = {
    one["kind"]: one for one in yaml.safe_load_all((DEPLOY / "kuberay.yaml").read_text())
}
CLUSTER, DEPLOYMENT = KUBERNETES["RayCluster"]["spec"], KUBERNETES["Deployment"]["spec"]
PODS: dict[str, dict[str, Any]] = {
    "head": CLUSTER["headGroupSpec"]["template"],
    "browsers": CLUSTER["workerGroupSpecs"][0]["template"],
    "gateway": DEPLOYMENT["template"],
}


@pytest.mark.parametrize("name", PODS)
def test_pods_are_confined_as_the_container_is(name: str) -> None:
    pod = PODS[name]["spec"]
    [container] = pod["containers"]
    confined = container["securityContext"]
    assert confined["runAsNonRoot"] is True
    assert confined["runAsUser"] == int(last_stage()["USER"].partition(":")[0])
    assert confined["readOnlyRootFilesystem"] is COMPOSE["read_only"]
    assert confined["allowPrivilegeEscalation"] is False
    assert confined["capabilities"] == {"drop": COMPOSE["cap_drop"]}
    profile = confined["seccompProfile"]
    assert profile["type"] == "Localhost"
    assert (
        f"deploy/seccomp.json as /var/lib/kubelet/seccomp/{profile['localhostProfile']}"
        in (DEPLOY / "kuberay.yaml").read_text()
    )
    assert pod["automountServiceAccountToken"] is False
    assert pod["shareProcessNamespace"] is True, "there is no init of our own"
    assert container["resources"]["requests"] == container["resources"]["limits"]
    mounted = {mount["mountPath"]: mount["name"] for mount in container["volumeMounts"]}
    volumes = {volume["name"]: volume["emptyDir"] for volume in pod["volumes"]}
    assert volumes.keys() == set(mounted.values())
    assert volumes[mounted["/tmp"]]["medium"] == "Memory"
    assert "medium" not in volumes[mounted["/tmp/ray"]]


def test_the_gateway_is_a_node_and_a_command_of_ours() -> None:
    [container] = PODS["gateway"]["spec"]["containers"]
    joins, _, serves = container["args"][0].partition(" && exec ")
    name = KUBERNETES["RayCluster"]["metadata"]["name"]
    assert joins.startswith(f"ray start --address={name}-head-svc:6379 --num-cpus=0 ")
    words = serves.split()
    assert words[:2] == ["webgym", "serve"]
    group: Any = typer.main.get_command(cli.build("serve"))
    context = group.commands["serve"].make_context("serve", words[2:])
    port = int(last_stage()["EXPOSE"])
    assert (context.params["ray"], context.params["port"], context.params["sandbox"]) == ("auto", port, "on")
    assert container["ports"][0]["containerPort"] == port
    assert container["readinessProbe"]["httpGet"]["path"] == "/healthz"
    assert {each["name"] for each in container["env"] if "valueFrom" in each} == {"WEBGYM_TOKEN"}
    assert DEPLOYMENT["replicas"] == 1
    assert DEPLOYMENT["strategy"]["type"] == "Recreate"
    service = KUBERNETES["Service"]["spec"]
    labels = PODS["gateway"]["metadata"]["labels"]
    assert service["selector"].items() <= labels.items()
    assert DEPLOYMENT["selector"]["matchLabels"].items() <= labels.items()
    assert service["ports"][0]["targetPort"] == container["ports"][0]["name"]
    first, last = map(int, context.params["worker_ports"].split("-"))
    policy = KUBERNETES["NetworkPolicy"]["spec"]
    selector = policy["podSelector"]["matchLabels"].items()
    assert all(selector <= pod["metadata"]["labels"].items() for pod in PODS.values())
    _, clients = policy["ingress"]
    assert clients["ports"] == [{"port": port}, {"port": first, "endPort": last}]


# --- the filter of system calls -----------------------------------------------------------------------


def test_the_filter_allows_what_is_named_and_nothing_dangerous() -> None:
    assert PROFILE["defaultAction"] == "SCMP_ACT_ERRNO"
    rules = PROFILE["syscalls"]
    assert {rule["action"] for rule in rules} == {"SCMP_ACT_ALLOW"}
    unconditional = [name for rule in rules if "args" not in rule for name in rule["names"]]
    assert len(set(unconditional)) == len(unconditional)
    assert not set(unconditional) & set(DANGEROUS)
    assert "socket" not in unconditional
    families = {rule["args"][0]["value"] for rule in rules if rule["names"] == ["socket"]}
    assert families == {1, 2, 10, 16}, "unix, IPv4, IPv6, netlink"


ATTEMPTS = """
import ctypes, errno, json, socket
libc = ctypes.CDLL(None, use_errno=True)
def tried(call):
    ctypes.set_errno(0)
    try:
        return errno.errorcode.get(ctypes.get_errno()) if call() == -1 else "done"
    except OSError as error:
        return errno.errorcode[error.errno]
print(json.dumps({
    "mount": tried(lambda: libc.mount(b"none", b"/tmp", b"tmpfs", 0, None)),
    "ptrace": tried(lambda: libc.ptrace(0, 0, 0, 0)),
    "packet": tried(lambda: socket.socket(socket.AF_PACKET)),
    "alg": tried(lambda: socket.socket(socket.AF_ALG)),
    "inet": tried(lambda: socket.socket(socket.AF_INET).close()),
}))
"""


@pytest.fixture
def confined() -> Iterator[tuple[Path, list[str]]]:
    """A folder of an ordinary user, and the beginning of a command that runs behind the filter."""
    if seccomp.library() is None:
        pytest.skip("no libseccomp to put the filter in force")
    interpreter = unprivileged.interpreter()
    if interpreter is None:
        pytest.skip("run by root with an interpreter that no other user can read")
    with unprivileged.scratch() as folder:
        profile = folder / "seccomp.json"
        profile.write_text(json.dumps(PROFILE))
        profile.chmod(0o644)
        yield folder, ["-c", Path(seccomp.__file__).read_text(), str(profile), interpreter]


def test_the_filter_refuses_as_if_the_kernel_had_no_such_call(confined: tuple[Path, list[str]]) -> None:
    folder, command = confined
    answer = unprivileged.python(folder, *command, "-c", ATTEMPTS)
    assert answer.returncode == 0, answer.stderr
    said = json.loads(answer.stdout)
    assert said.pop("inet") == "done"
    assert set(said.values()) == {"ENOSYS"}


@pytest.mark.browser
def test_a_server_with_its_sandbox_works_behind_the_filter(confined: tuple[Path, list[str]]) -> None:
    folder, command = confined
    serve = Path(__file__).with_name("browser") / "contained.py"
    answer = unprivileged.python(folder, *command, "-c", serve.read_text(), "auto", str(find_browser().path))
    assert answer.returncode == 0, answer.stderr
    said = json.loads(answer.stdout)
    assert said["picture"] == "\x89PNG"
    assert said["left"] == []
    assert said["own"]["Seccomp"] == "2"
    if unprivileged.can_make_namespaces(folder):
        assert said["info"] == {"sandboxed": True, "reason": ""}
        [renderer] = [one for one in said["processes"].values() if one["kind"] == "renderer"]
        assert int(renderer["Seccomp_filters"]) > int(said["own"]["Seccomp_filters"])
        assert renderer["user"] != said["own"]["user"]


@pytest.mark.slow
@pytest.mark.browser
def test_a_node_of_a_ray_cluster_works_behind_the_filter(confined: tuple[Path, list[str]]) -> None:
    """Ray, the gateway and a browser, as the pods of ``deploy/kuberay.yaml`` confine them."""
    pytest.importorskip("ray")
    folder, command = confined
    node = Path(__file__).with_name("server") / "confined.py"
    answer = unprivileged.python(folder, *command, "-c", node.read_text(), str(find_browser().path))
    assert answer.returncode == 0, answer.stderr
    said = json.loads(answer.stdout.splitlines()[-1])
    assert said["picture"] == "\x89PNG"
    assert {"raylet", "ray::NodeActor", "webgym.server.subprocess_worker"} <= said["filters"].keys()
    assert set(said["filters"].values()) == {"2"}
    assert {int(each, 16) for each in said["capabilities"].values()} == {0}
    if unprivileged.can_make_namespaces(folder):
        assert said["info"] == {"sandboxed": True, "reason": ""}
