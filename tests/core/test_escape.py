"""Names from elsewhere, in tables that programs read."""

import pytest

from specklegen.core.display.escape import cell, csv_cell, markdown, markdown_code


@pytest.mark.parametrize("text", ["=1+1", "+1", "-cmd", "@sum", "\tx", "\r=1"])
def test_a_formula_stays_a_text(text):
    assert csv_cell(text) == "'" + text
    assert csv_cell("g = " + text) == "g = " + text


def test_a_name_does_not_leave_its_place():
    evil = "a`b|c\n# heading <script> [link](x)"
    assert "\n" not in markdown(evil) + markdown_code(evil) + cell(evil)
    assert markdown(evil) == "a\\`b\\|c \\# heading \\<script\\> \\[link\\](x)"
    assert markdown_code(evil) == "`a'b¦c # heading <script> [link](x)`"
    assert cell(evil) == "a`b\\|c # heading <script> [link](x)"
