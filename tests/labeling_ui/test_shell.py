"""What is put around viser's page."""

import pytest

from labeling_ui.shell.page_shell import Shell

THEIRS = (
    b'<!doctype html><head><link rel="icon" href="x"/><title>Viser</title>%s</head>'
)
PROGRAM = b"<script><title>in the program</title></script>"


def test_ours_comes_first_and_their_program_stays_as_it_is() -> None:
    page = Shell(title="Which?", scene="Two").around(THEIRS % PROGRAM)
    assert page.count(b"<title>gaitpref - Which?</title>") == 1
    assert b"<title>Viser</title>" not in page
    assert page.index(b"gp-cover") < page.index(PROGRAM)


def test_a_word_cannot_end_the_script() -> None:
    """And another word is another version, which an open page loads anew."""
    shell = Shell(title="Which?", scene="</script><script>alert(1)")
    assert b"</script><script>alert" not in shell.around(THEIRS % PROGRAM)
    assert shell.version != Shell(title="Which?", scene="Two").version


def test_what_is_no_page_is_refused() -> None:
    with pytest.raises(ValueError, match="no <head>"):
        Shell(title="Which?", scene="Two").around(b"busy")
