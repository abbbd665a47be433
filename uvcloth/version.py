"""Version of this package as it is installed."""

from importlib.metadata import PackageNotFoundError, version


def package_version() -> str:
    """The version of this package."""
    try:
        return version("uvcloth")
    except PackageNotFoundError:
        return "not installed"


__version__ = package_version()
