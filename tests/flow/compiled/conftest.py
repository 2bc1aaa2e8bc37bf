"""Robots as users have them: what is compiled, and when, is what these tests are about."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def as_users_have_them(slow_robots: None) -> None:
    """No kernel is there before a test asks for one."""
