"""The cache of machine code: found again, remade where it is damaged, not used where it is not safe."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from running import run
from small_models import DECAY, OSCILLATOR, At, a_class, a_model

from hierc.runtime.machine import program, unit
from hierc.runtime.model import Model
from hierc.runtime.run import FinishedRun


def decay(rate: float = 1.0) -> Model:
    return a_model({"d": At(DECAY, (), 1)}, None, {"k": rate})


def right(finished: FinishedRun, rate: float = 1.0) -> bool:
    return math.isclose(
        finished.groups[0](finished.groups[0].knots[-1:])[0, 0], math.exp(-rate), rel_tol=1e-5
    )


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HIERC_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache" / "objects"


@pytest.fixture
def compiled(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Texts compiled, in order. The kernel's takes seconds, so its object is made once and given again."""
    texts: list[str] = []

    def counted(text: str) -> bytes:
        texts.append(text)
        if text not in _OBJECTS:
            _OBJECTS[text] = unit.compile_object(text)
        return _OBJECTS[text]

    monkeypatch.setattr(program, "compile_object", counted)
    return texts


_OBJECTS: dict[str, bytes] = {}


def test_what_is_there_is_used(folder: Path, compiled: list[str]) -> None:
    announced: list[str] = []
    model = decay()
    settings = {
        "start": 0.0,
        "stop": 1.0,
        "rtol": 1e-6,
        "atol": 1e-6,
        "method": "radau5",
        "max_step": 1.0,
        "min_step": 0.0,
    }
    model.engine.run(model.system(), settings, {}, announce=announced.append)
    assert len(compiled) == 3  # the kernel, the steps of the method, and one form
    assert len(announced) == 2
    assert len(list(folder.glob("*.o"))) == 3
    again = decay()
    assert right(again.engine.run(again.system(), settings, {}, announce=announced.append))
    assert len(compiled) == 3
    assert len(announced) == 2


def test_nothing_of_a_form_is_lowered_that_is_there(
    folder: Path, compiled: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    run(decay(), 1.0, method="radau5")
    monkeypatch.setattr(program, "Composer", lambda *_: pytest.fail("lowered again"))
    assert right(run(decay(), 1.0, method="radau5"))


def test_other_text_or_method_is_another_object(folder: Path, compiled: list[str]) -> None:
    run(decay(), 1.0, method="radau5")
    run(decay(2.0), 1.0, method="radau5")  # parameters are not code
    assert len(compiled) == 3
    run(decay(), 1.0, method="tsit5")
    other = a_class("Decay", {"x": "-2.0*p[0]*x[0]"}, {(0, 0): "-2.0*p[0]"}, start=["1.0"], values=["q[0]"])
    assert right(run(a_model({"d": At(other, (), 1)}, None, {"k": 1.0}), 1.0, method="radau5"), 2.0)
    assert len(compiled) == 6


def test_two_models_share_the_form_of_equal_groups(folder: Path, compiled: list[str]) -> None:
    run(decay(), 1.0, method="radau5")
    run(
        a_model({f"d{k}": At(DECAY, (), 1) for k in range(5)}, None, {f"k{k}": 1.0 for k in range(5)}),
        1.0,
        method="radau5",
    )
    assert len(compiled) == 3


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: b"",
        lambda content: content[:-10],
        lambda content: (
            content[: len(content) // 2]
            + bytes([content[len(content) // 2] ^ 1])
            + content[len(content) // 2 + 1 :]
        ),
        lambda content: content.replace(b'"work": ', b'"work": 1', 1) if b'"work"' in content else b"",
        lambda content: b"not json\n" + content,
        lambda content: b"[1, 2]\n" + content.split(b"\n", 1)[1],
        lambda content: b"{}\n" + content.split(b"\n", 1)[1],
        lambda content: b"\xff\xfe\n" + content,
        lambda content: content.replace(b"\n", b"", 1),
    ],
    ids=["empty", "cut", "flipped", "other facts", "no json", "a list", "no digest", "no text", "one line"],
)
def test_damaged_objects_are_made_again(folder: Path, compiled: list[str], damage: object) -> None:
    run(decay(), 1.0, method="radau5")
    whole = {file: file.read_bytes() for file in folder.glob("*.o")}
    for file, content in whole.items():
        file.write_bytes(damage(content))
    assert right(run(decay(), 1.0, method="radau5"))
    assert len(compiled) == 6
    assert {file: file.read_bytes() for file in folder.glob("*.o")} == whole


def test_the_digest_in_the_file_is_that_of_the_code(folder: Path, compiled: list[str]) -> None:
    import hashlib

    run(decay(), 1.0, method="radau5")
    for file in folder.glob("*.o"):
        line, code = file.read_bytes().split(b"\n", 1)
        facts = json.loads(line)
        digest = facts.pop("digest")
        known = json.dumps(facts, sort_keys=True).encode()
        assert digest == hashlib.sha256(known + b"\n" + code).hexdigest()


def test_an_empty_variable_switches_the_cache_off(
    tmp_path: Path, compiled: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HIERC_CACHE", "")
    monkeypatch.chdir(tmp_path)
    assert right(run(decay(), 1.0, method="radau5"))
    assert right(run(decay(), 1.0, method="radau5"))
    assert len(compiled) == 6
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("which", ["root", "objects"])
def test_a_folder_that_others_may_write_to_is_not_used(folder: Path, compiled: list[str], which: str) -> None:
    run(decay(), 1.0, method="radau5")
    before = sorted(folder.glob("*"))
    (folder if which == "objects" else folder.parent).chmod(0o777)
    assert right(run(decay(), 1.0, method="radau5"))
    assert len(compiled) == 6  # neither read …
    run(a_model({"o": At(OSCILLATOR, (), 1)}, None, {"w": 1.0}), 1.0, method="radau5")
    assert sorted(folder.glob("*")) == before  # … nor written


def test_a_folder_that_cannot_be_made(
    tmp_path: Path, compiled: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("HIERC_CACHE", str(tmp_path / "file" / "cache"))
    assert right(run(decay(), 1.0, method="radau5"))


def test_a_disk_that_is_full(folder: Path, compiled: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError("no space left")

    monkeypatch.setattr(program, "write_whole", full)
    assert right(run(decay(), 1.0, method="radau5"))


def test_objects_depend_on_the_machine(
    folder: Path, compiled: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    run(decay(), 1.0, method="radau5")
    monkeypatch.setattr(program, "machine_key", lambda: "another processor")
    run(decay(), 1.0, method="radau5")
    assert len(compiled) == 6
    assert len(list(folder.glob("*.o"))) == 6
