"""A bounded share of the seeded nonsense of `scripts/fuzz.py`."""

import os

import fuzz
import pytest

posix = pytest.mark.skipif(os.name != "posix", reason="alarms")


@posix
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize(
    "kind", [{"check": 80}, {"solve": 4}, {"verify": 8}], ids=lambda kind: next(iter(kind))
)
def test_nonsense_breaks_nothing(kind, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(fuzz, "LONGEST", 120.0)  # the machine may be busy
    monkeypatch.setattr(fuzz, "MOST", float("inf"))  # of all tests of this process
    asked = {"check": 0, "solve": 0, "verify": 0, **kind}
    assert [str(one) for one in fuzz.fuzz(**asked, seed=1)] == []


@posix
def test_what_breaks_is_named(monkeypatch, tmp_path):
    def fail(call):
        raise IndexError("list index out of range")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(fuzz, "status", fail)
    (one,) = fuzz.fuzz(check=1, solve=0, verify=0, seed=2)
    assert "seed 2, call 0: IndexError: list index out of range" in str(one)


@posix
def test_the_script_says_what_it_tried(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["fuzz.py", "--check", "2", "--solve", "0", "--verify", "0"])
    with pytest.raises(SystemExit) as ended:
        fuzz.main()
    assert ended.value.code == 0
    assert capsys.readouterr().out == "check 2, solve 0, verify 0, seed 0 - 0 broken\n"
