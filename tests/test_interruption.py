"""Ctrl-C noted: once, twice, nested, while patient, outside the main thread."""

import signal
import threading

import pytest

from nhpocp.errors import InvalidProblemError
from nhpocp.solvers.interruption import Interruption


def press(times=1):
    for _ in range(times):
        signal.raise_signal(signal.SIGINT)


def test_the_first_signal_is_noted_and_the_second_raises():
    before = signal.getsignal(signal.SIGINT)
    with Interruption() as interruption:
        assert not interruption.noted
        interruption.check()
        press()
        assert interruption.noted
        with pytest.raises(KeyboardInterrupt):
            interruption.check()
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
    with Interruption(patient=which == "outer") as outer:
        with Interruption(patient=which == "inner"):
            press(5)
        assert outer.noted
        if which == "inner":
            with pytest.raises(KeyboardInterrupt):
                press()
        outer.patient = True
        press()


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
