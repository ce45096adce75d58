"""How the program speaks and ends: help, exit codes, one line on stderr, pipes that close, interruptions, packages that are not ours."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import documents
import pytest

from kinematics.errors import InputError, blame, choose
from kinematics.jit import shipped
from kinematics.jit.support import PLAIN
from planning.motion.pick_place import ITERATIONS
from planning.policies import POLICIES
from planning.scenes.generation import SPECS
from retrieve_cli.__main__ import OURS, check_packages
from retrieve_cli.errors import BUG, guarded

ROOT = Path(__file__).resolve().parents[2]
RETRIEVE = (sys.executable, "-W", "error", "-m", "retrieve_cli")
COMMANDS = (
    "gen", "scene", "grasp", "sense", "plan", "verify", "export", "report", "show", "label", "train", "robots", "schema", "warmup", "demo",
)  # fmt: skip

Spoken = tuple[int, str, str]


def process(*args: str | Path, stdin: str = "", cwd: Path = ROOT, **environment: str) -> Spoken:
    """Run the program on its own: (exit code, stdout, stderr)."""
    done = subprocess.run(
        [*RETRIEVE, *args], input=stdin, cwd=cwd, env={**os.environ, **environment}, capture_output=True, text=True, timeout=60, check=False
    )
    return done.returncode, done.stdout, done.stderr


@pytest.fixture
def plans(tmp_path: Path) -> Path:
    file = tmp_path / "plans.jsonl"
    file.write_text(documents.lines(*(documents.plan(f"0-{i}") for i in range(3))))
    return file


# Help -----------------------------------------------------------------------------------------------------------------------------------


def test_help_lists_every_command_and_only_those(retrieve: Callable[..., Spoken]) -> None:
    code, out, err = retrieve("--help")
    assert (code, err) == (0, "")
    listed = re.findall(r"^│ ([a-z]+)  ", out.split("─ Scenes ─")[1], re.MULTILINE)
    assert tuple(listed) == COMMANDS
    assert retrieve()[:2] == (0, out)


@pytest.mark.parametrize(
    ("words", "completed"), [("retrieve pl", {"plan"}), ("retrieve plan --ru", {"--rule"}), ("retrieve plan --rule s", {"strict"})]
)
def test_the_shell_completes(words: str, completed: set[str]) -> None:
    asked = {"_RETRIEVE_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
    code, out, err = process(**asked)
    assert (code, set(out.split()), err) == (0, completed, "")


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_a_command(command: str, retrieve: Callable[..., Spoken]) -> None:
    code, out, err = retrieve(command, "-h")
    assert (code, err) == (0, "")
    assert f"Usage: retrieve {command}" in out


@pytest.mark.parametrize("command", ["gen", "label"])
def test_help_names_every_spec(command: str, retrieve: Callable[..., Spoken]) -> None:
    words = " ".join(retrieve(command, "--help")[1].replace("│", " ").split())
    assert f"{', '.join(SPECS)}, or a TOML file" in words


def test_help_names_every_policy(retrieve: Callable[..., Spoken]) -> None:
    words = " ".join(retrieve("plan", "--help")[1].replace("│", " ").split())
    said = words[words.index("neural (the default where") : words.index(", or your own")]
    assert {f"{name}-paper" for name in ("osnet-only", "rpnet-only")} | set(re.findall(r"[a-z]+(?:-[a-z]+)*", said)) >= set(POLICIES)
    assert f"if left out {ITERATIONS}." in words


def test_help_is_quick() -> None:
    """0.2 s of processor time: nothing heavy is imported for it. Processor time, for a busy machine would be no fault of ours."""
    times = []
    for _ in range(3):
        begin = os.times()
        assert process("--help")[0] == 0
        end = os.times()
        times.append(end.children_user + end.children_system - begin.children_user - begin.children_system)
    assert 0.01 < min(times) < 1.0


def test_version(retrieve: Callable[..., Spoken]) -> None:
    code, out, err = retrieve("--version")
    assert (code, err) == (0, "")
    assert re.fullmatch(r"retrieve \d+\.\d+\.\d+\n", out)


# Bad input ------------------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("args", "says"),
    [
        (["paln"], "retrieve: No such command 'paln'"),
        (["plan", "--polic", "local"], "retrieve plan: No such option: --polic"),
        (
            ["gen", "--xacro-arg", "a:=1"],
            "retrieve gen: No such option: --xacro-arg; it is one of retrieve robots (see retrieve gen --help)",
        ),
        (["verify", "--fit"], "retrieve verify: No such option: --fit; it is one of retrieve gen, label (see retrieve verify --help)"),
        (["plan", "--rule", "depe"], "retrieve plan: Invalid value for '--rule': "),
        (["gen", "-n", "0"], "retrieve gen: Invalid value for '-n': "),
        (["gen", "-n", "many"], "retrieve gen: Invalid value for '-n': "),
        (["gen", "--seed", "-1"], "retrieve gen: Invalid value for '--seed': "),
        (["report", "-o"], "retrieve report: Option '-o' requires an argument"),
        (["report", "x.jsonl", "-o", "x.pdf"], "x.pdf: the ending says the form, and '.pdf' is not one of .md, .csv, .tex, .html, .json"),
        (["report", "missing.jsonl"], "missing.jsonl: no such file"),
        (["report", "tests"], "tests: is a folder, not a file"),
    ],
)
def test_a_wrong_call_is_one_line_and_exit_2(args: Sequence[str], says: str, retrieve: Callable[..., Spoken]) -> None:
    code, out, err = retrieve(*args)
    assert (code, out) == (2, "")
    assert err.startswith(says)
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "plans.jsonl: there is nothing in it; name a file of plans or pipe them in: "),
        ('{"schema": "retrieve/plan@1",\n', "plans.jsonl:1: broken JSON at column 30: "),
        (documents.lines(documents.plan(), documents.scene()), "plans.jsonl:2: schema: this is a scene, and a plan is expected; "),
        (documents.lines({**documents.plan(), "hand_travel_m": -1}), "plans.jsonl:1: hand_travel_m: -1 is below 0\n"),
    ],
)
def test_a_wrong_file_is_one_line_and_exit_2(text: str, says: str, plans: Path, retrieve: Callable[..., Spoken]) -> None:
    plans.write_text(text)
    code, out, err = retrieve("report", plans)
    assert (code, out) == (2, "")
    assert err.startswith(f"{plans.parent}/{says}")
    assert err.count("\n") == 1


def test_a_place_that_can_not_be_written(plans: Path, retrieve: Callable[..., Spoken]) -> None:
    code, _, err = retrieve("report", plans, "-o", plans.parent / "nowhere" / "r.md")
    assert (code, err) == (2, f"{plans.parent}/nowhere/r.md: the folder {plans.parent}/nowhere does not exist; make it first\n")


def test_a_full_disk_is_no_bug() -> None:
    def full() -> None:
        raise OSError(28, "No space left on device")

    assert guarded(full) == 2


@pytest.mark.parametrize("args", [("--debug", "report", "missing.jsonl"), ("report", "missing.jsonl", "--debug")])
def test_debug_shows_the_traceback_wherever_it_stands(args: Sequence[str], retrieve: Callable[..., Spoken]) -> None:
    with pytest.raises(InputError, match=r"missing.jsonl: no such file"):
        retrieve(*args)


def test_a_bug_says_that_it_is_one(capsys: pytest.CaptureFixture[str]) -> None:
    def job() -> None:
        raise ZeroDivisionError("division\nby zero")

    assert guarded(job) == BUG
    assert capsys.readouterr().err == (
        "this is a bug in retrieve, not in your input: ZeroDivisionError: division by zero (the same call with --debug says where)\n"
    )
    with pytest.raises(ZeroDivisionError):
        guarded(job, debug=True)


def test_the_terminal_as_stdin_gets_a_hint() -> None:
    pty = pytest.importorskip("pty")
    us, them = pty.openpty()
    done = subprocess.run([*RETRIEVE, "report"], stdin=them, cwd=ROOT, capture_output=True, text=True, timeout=60, check=False)
    os.close(us)
    os.close(them)
    assert (done.returncode, done.stdout) == (2, "")
    how = "name a file of plans or pipe them in: retrieve gen -n 20 | retrieve plan | retrieve report"
    assert done.stderr == f"no file is named, and stdin is the terminal: {how}\n"


def test_what_helps_the_commands_to_complain() -> None:
    assert choose("policy", "local", {"random": 1, "local": 2}) == "local"
    with pytest.raises(InputError, match=re.escape("unknown policy 'locl' (did you mean 'local'?); the valid names are random, local")):
        choose("policy", "locl", ["random", "local"])
    with pytest.raises(InputError, match=re.escape("scenes.jsonl:3: robot: unknown robot 'ur7'")), blame("scenes.jsonl:3: robot"):
        raise ValueError("unknown robot\n 'ur7'")
    with pytest.raises(InputError, match=re.escape("x: 'a'")), blame("x", KeyError):
        raise KeyError("a")
    with pytest.raises(KeyError), blame("x"):
        raise KeyError("a")


# Streams --------------------------------------------------------------------------------------------------------------------------------


def test_report_reads_stdin(plans: Path) -> None:
    """Two files in one stream, "-" or nothing; and a locale without ± is no obstacle."""
    text = plans.read_text() * 2
    code, out, _ = process("report", stdin=text, LC_ALL="C", PYTHONUTF8="0", PYTHONCOERCECLOCALE="0")
    assert code == 0
    assert "6 of 6" in out
    assert "1.689 ± 0.962" in out
    assert process("report", "-", "--json", stdin=text)[0] == 0


def test_what_ships_is_read_as_utf_8_in_any_locale() -> None:
    code, out, err = process("robots", "ur5e", LC_ALL="C", PYTHONUTF8="0", PYTHONCOERCECLOCALE="0")
    assert code == 0, err
    assert "shoulder_pan_joint" in out


@pytest.mark.parametrize("args", [["report", "--json"], ["report"], ["--help"]], ids=" ".join)
def test_a_closed_pipe_ends_quietly(args: Sequence[str], plans: Path) -> None:
    with (
        plans.open() as stdin,
        subprocess.Popen([*RETRIEVE, *args], stdin=stdin, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=ROOT) as p,
    ):
        assert p.stdout is not None
        assert p.stderr is not None
        p.stdout.close()  # before a word was said, as `| true` does
        assert p.stderr.read() == b""
        assert p.wait(60) == 0


def test_head_ends_quietly(plans: Path) -> None:
    """`retrieve report … --json | head -1` with more output than a pipe holds."""
    many = plans.with_name("many.jsonl")
    many.write_text(documents.lines(*(documents.plan(f"0-{i}", policy=f"p{i}") for i in range(200))))
    command = f"set -o pipefail; {' '.join(RETRIEVE)} report {many} --json | head -1"
    done = subprocess.run(["bash", "-c", command], cwd=ROOT, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "{\n", "")


def test_an_interruption_ends_quietly(plans: Path) -> None:
    with subprocess.Popen(
        [*RETRIEVE, "report"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=ROOT,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a shell ignores it for what runs in the background
    ) as p:  # fmt: skip
        assert p.stdin is not None
        assert p.stderr is not None
        line = plans.read_bytes().splitlines(keepends=True)[0]
        for _ in range(1 + 300_000 // len(line)):  # more than the pipe holds: when all is written, the program is reading
            p.stdin.write(line)
        p.stdin.flush()
        p.send_signal(signal.SIGINT)
        assert p.wait(60) == 130
        assert p.stderr.read() == b""


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
@pytest.mark.parametrize("words", [ImportError("cannot load module"), InputError("torch is not installed")])
def test_an_import_that_is_broken_off_counts_as_interrupted_whatever_it_says(
    number: int, code: int, words: Exception, capsys: pytest.CaptureFixture[str]
) -> None:
    def job() -> None:
        try:
            signal.raise_signal(number)
        except BaseException:  # as C code that begins a module does
            raise words from None

    inherited = signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in what a shell starts in the background
    try:
        assert guarded(job) == code
        assert capsys.readouterr().err == ""
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, inherited)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_that_comes_while_an_object_is_cleared_away_is_not_lost(
    number: int, code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    class Gone:
        def __del__(self) -> None:
            signal.raise_signal(number)  # what it raises here Python drops

    def job() -> None:
        Gone()
        late = time.monotonic() + 30
        while time.monotonic() < late:
            time.sleep(0.01)

    inherited, hook = signal.signal(signal.SIGINT, signal.default_int_handler), sys.unraisablehook
    try:
        assert guarded(job) == code
        assert capsys.readouterr().err == ""
        assert sys.unraisablehook is hook
    finally:
        signal.signal(signal.SIGINT, inherited)


def test_what_else_is_dropped_is_told_as_ever(capsys: pytest.CaptureFixture[str]) -> None:
    class Gone:
        def __del__(self) -> None:
            raise ValueError("a fault of ours")

    def job() -> None:
        Gone()

    told = list[str]()
    hook, sys.unraisablehook = sys.unraisablehook, lambda said: told.append(str(said.exc_value))
    try:
        assert guarded(job) == 0
    finally:
        sys.unraisablehook = hook
    assert told == ["a fault of ours"]


def test_an_interrupt_in_code_of_a_string_has_the_same_exit_code(tmp_path: Path) -> None:
    """As dataclasses and named tuples are made: `python -m` would end by SIGINT, which callers other than shells see as -2."""
    program = 'import sys\nfrom retrieve_cli.errors import guarded\nsys.exit(guarded(lambda: exec("raise KeyboardInterrupt")))\n'
    (tmp_path / "interrupted.py").write_text(program)
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(tmp_path)])}
    done = subprocess.run([sys.executable, "-m", "interrupted"], env=env, capture_output=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (130, b"")


# The first run --------------------------------------------------------------------------------------------------------------------------


@pytest.mark.skipif(bool(PLAIN) or not shipped.entries(), reason="functions are compiled otherwise here")
def test_a_first_run_says_how_long_it_takes_and_whether_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    (tmp_path / "file").write_text("")
    said = [process("plan", XDG_CACHE_HOME=str(tmp_path / name))[2].splitlines()[0] for name in ("cache", "file")]
    takes = r"getting ready: (this once )?\d+ functions are compiled, which takes about \d+ s"
    assert re.fullmatch(takes + "; later runs start at once", said[0])
    assert re.fullmatch(takes + r", in every run, for they can't be kept: .*file/.*; XDG_CACHE_HOME names another folder", said[1])


# Packages -------------------------------------------------------------------------------------------------------------------------------


def test_our_packages_are_ours() -> None:
    check_packages(ROOT)


def test_another_package_in_front_is_named(tmp_path: Path) -> None:
    (tmp_path / "planning").mkdir()
    (tmp_path / "planning" / "__init__.py").write_text("raise SystemExit('imported')")
    info = tmp_path / "planningtools-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: planningtools\nVersion: 1.0\n")
    (info / "RECORD").write_text("planning/__init__.py,,\n")
    code, out, err = process("--version", cwd=tmp_path, PYTHONPATH=str(ROOT))
    assert (code, out) == (2, "")
    assert err.startswith(f"the package planning is not retrieve's own: it was found in {tmp_path}/planning, not in {ROOT}/planning")
    assert "(it belongs to the distribution planningtools); install retrieve in an environment of its own: " in err
    assert err.count("\n") == 1


@pytest.fixture
def installed(tmp_path: Path) -> Path:
    """A folder like site-packages with our packages in it."""
    site = tmp_path / "site"
    info = site / "retrieve-0.1.0.dist-info"
    info.mkdir(parents=True)
    record = []
    for package in OURS:
        (site / package).mkdir()
        for file in (ROOT / package).glob("*.py"):
            (site / package / file.name).write_bytes(file.read_bytes())
            record.append(f"{package}/{file.name},sha256=x,{file.stat().st_size}\n")
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: retrieve\nVersion: 9.8.7\n")
    (info / "RECORD").write_text("".join(record) + "retrieve-0.1.0.dist-info/RECORD,,\n")
    return site


def test_an_installed_program_knows_its_version(installed: Path) -> None:
    assert process("--version", cwd=installed) == (0, "retrieve 9.8.7\n", "")


def test_a_wheel_unpacked_over_ours_is_named(installed: Path) -> None:
    changed = installed / "kinematics" / "scene.py"
    changed.write_text("x = 1\n")
    assert process("--version", cwd=installed)[0] == 0  # changed by hand: the user's business
    other = installed / "kinematics-0.3.dist-info"
    other.mkdir()
    (other / "METADATA").write_text("Metadata-Version: 2.1\nName: kinematics\nVersion: 0.3\n")
    (other / "RECORD").write_text("kinematics/scene.py,sha256=y,6\n")
    code, _, err = process("--version", cwd=installed)
    assert code == 2
    assert err.startswith(f"{changed} was overwritten by the distribution kinematics; install retrieve in an environment of its own: ")
    changed.unlink()
    code, _, err = process("--version", cwd=installed)
    assert code == 2
    assert err.startswith(f"{changed} is missing: another package's removal took it along; ")
