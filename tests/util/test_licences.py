"""Licences of cards and recordings by SPDX identifiers, with plain words for none."""

import pytest

from tactileforge.errors import ConfigError
from tactileforge.util.licences import check_data_licence, check_licence


@pytest.mark.parametrize(
    "licence", ["MIT", "CC-BY-NC-4.0", "MIT OR Apache-2.0", "LicenseRef-lab", "NOASSERTION"]
)
def test_identifiers_and_names_of_ones_own(licence: str) -> None:
    check_licence("card x", licence)
    check_data_licence("layout 'x'", licence)


@pytest.mark.parametrize("licence", ["", "none stated, do not redistribute", "see its page"])
def test_recordings_without_a_licence_say_so_in_words(licence: str) -> None:
    check_data_licence("layout 'x'", licence)
    with pytest.raises(ConfigError, match="NOASSERTION where none is stated"):
        check_licence("card x", licence)


@pytest.mark.parametrize(
    ("licence", "meant"),
    [
        ("mit", "MIT"),
        ("MIT License", "MIT"),
        ("apache", "Apache-2.0"),
        ("Apache License, Version 2.0", "Apache-2.0"),
        ("cc by 4.0", "CC-BY-4.0"),
        ("CC-BY-NC-SA", "CC-BY-NC-SA-4.0"),
    ],
)
def test_a_slip_names_the_identifier(licence: str, meant: str) -> None:
    for check in (check_licence, check_data_licence):
        with pytest.raises(
            ConfigError, match=f"^here: .* did you mean '{meant}'[?] Known: "
        ) as told:
            check("here", licence)
        assert "\n" not in str(told.value)


def test_one_word_without_a_meaning_is_refused() -> None:
    with pytest.raises(
        ConfigError, match=r"'wtf' is not an SPDX identifier\. Known: .*LicenseRef-NAME"
    ):
        check_data_licence("layout 'x'", "wtf")
