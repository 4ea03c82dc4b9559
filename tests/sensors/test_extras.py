"""What needs a package that is missing says which, and the command that installs it."""

import pytest

from sensors.errors import InputError
from sensors.extras import import_extra


def test_a_missing_package_is_named_with_the_command_that_installs_it() -> None:
    with pytest.raises(InputError) as error:
        import_extra("no_such_package.reader", "files", "record.tdms")
    assert str(error.value) == (
        "record.tdms: no_such_package is needed for it; pip install 'pilewatch[files]'"
    )


def test_a_package_that_is_there_is_imported() -> None:
    assert import_extra("json.decoder", "files", "record.tdms").JSONDecoder is not None
