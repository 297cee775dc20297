"""Shared by all tests: caches of their own, and `--accept` for golden cases."""

from __future__ import annotations

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--accept", action="store_true", help="write what golden cases print as their expected text"
    )


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> object:
    """Keep the user's cache out of the tests; one of the session's own, so that the kernel is compiled once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HIERC_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield
