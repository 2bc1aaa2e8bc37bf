"""Ctrl-C noted: once, twice, nested, while patient, outside the main thread."""

import os
import signal
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from nhpocp import interruption
from nhpocp.errors import InvalidProblemError
from nhpocp.interruption import Interruption, while_wanted


def press(times=1):
    for _ in range(times):
        signal.raise_signal(signal.SIGINT)


def test_the_first_signal_is_noted_and_the_second_raises():
    before = signal.getsignal(signal.SIGINT)
    with Interruption() as noting:
        assert not noting.noted
        noting.check()
        press()
        assert noting.noted
        with pytest.raises(KeyboardInterrupt):
            noting.check()
        with pytest.raises(KeyboardInterrupt):
            press()
    assert signal.getsignal(signal.SIGINT) is before


def test_an_inner_one_begins_with_what_the_outer_noted():
    with Interruption() as outer:
        press()
        with Interruption() as inner:
            assert inner.noted
            assert not inner.outermost
            with pytest.raises(KeyboardInterrupt):
                press()
    assert outer.outermost


def test_the_outer_one_sees_what_arrived_within_the_inner():
    with Interruption() as outer:
        with Interruption() as inner:
            press()
        assert outer.noted
        with Interruption() as later:
            assert later.noted
    assert inner.noted
    with Interruption() as fresh:
        assert not fresh.noted


@pytest.mark.parametrize("which", ["outer", "inner"])
def test_no_signal_raises_while_one_of_them_is_patient(which):
    with Interruption(patient=True if which == "outer" else None) as outer:
        with Interruption(patient=True if which == "inner" else None):
            press(5)
        assert outer.noted
        if which == "inner":
            with pytest.raises(KeyboardInterrupt):
                press()
        outer.patient = True
        press()


def test_the_innermost_that_says_whether_it_is_patient_counts():
    with Interruption(patient=True), Interruption(patient=False), Interruption():
        press()
        with pytest.raises(KeyboardInterrupt):
            press()


def looking_at_nothing(seconds=20.0):
    """Work that asks nobody."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        time.sleep(0.01)
    pytest.fail("nobody came")


def test_what_nobody_looks_at_is_raised_and_raised_again(monkeypatch):
    monkeypatch.setattr(interruption, "PATIENCE", 0.1)
    with Interruption() as noting:
        press()
        for _ in range(2):
            with pytest.raises(KeyboardInterrupt):
                looking_at_nothing()
        assert noting.noted
        assert not noting.insisted


def test_the_reminder_wakes_up_who_waits_and_respects_patience(monkeypatch):
    monkeypatch.setattr(interruption, "PATIENCE", 0.05)
    with Interruption(patient=True) as patient:
        press()
        time.sleep(0.3)
        patient.patient = None
        with pytest.raises(KeyboardInterrupt):
            threading.Event().wait(20.0)
    time.sleep(0.2)  # whoever reminds is gone now


def test_what_is_no_longer_wanted_is_noted_in_any_thread():
    wanted = [True]

    def work():
        with while_wanted(lambda: wanted[0]), Interruption() as inner:
            inner.check()
            wanted[0] = False
            return inner.noted

    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(work).result()
    assert not Interruption().noted


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_forked_process_begins_with_a_clean_slate():
    with Interruption():
        press()
        child = os.fork()
        if child == 0:
            fresh = Interruption()
            os._exit(int(fresh.noted or signal.getsignal(signal.SIGINT) is not signal.default_int_handler))
        assert os.waitpid(child, 0)[1] == 0


def test_what_wrappers_make_of_the_second_signal_is_a_keyboard_interrupt_again():
    def wrapper():
        try:
            press(2)
        except KeyboardInterrupt:
            raise SystemError("returned a result with an exception set") from None

    with pytest.raises(KeyboardInterrupt), Interruption(), Interruption():
        wrapper()
    with pytest.raises(SystemError), Interruption():
        raise SystemError("of its own")
    with pytest.raises(InvalidProblemError), Interruption():
        our_own_error_after_two_signals()


def our_own_error_after_two_signals():
    with pytest.raises(KeyboardInterrupt):
        press(2)
    raise InvalidProblemError("what went wrong afterwards")


def test_outside_the_main_thread_it_does_nothing():
    seen = []

    def work():
        with Interruption() as inner:
            inner.check()
            seen.append(inner.noted)

    with Interruption():
        press()
        thread = threading.Thread(target=work)
        thread.start()
        thread.join()
    assert seen == [False]
