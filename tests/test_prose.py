"""The count of faults of style that `make lint` compares with the ceilings."""

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = """# Page

The first sentence is right: 0.05 mm, version 1.2.3 and `.5` in code.

| .5 | .6 | .7 |
|---|---|---|

```python
x = .5  # the atlas
```

{sentence}
"""


@pytest.fixture(scope="module")
def check_prose():
    sys.path.insert(0, str(ROOT / "scripts"))
    import check_prose
    yield check_prose
    sys.path.remove(str(ROOT / "scripts"))


@pytest.mark.parametrize(("sentence", "rule"), [
    ("The page ends here.", None),
    ("The value is .5 here.", "figure without zero"),
    ("The atlas is a table.", "private word"),
    ("It takes 1 s, 2 s or 3 s.", "many figures"),
    ("Salmon, *As easy as 1, 2, 3* (SC11).", None),
    ("It takes **1 s, 2 s or 3 s**.", "many figures"),
    ("A word " * 18 + "is too many.", "long sentence"),
])  # fmt: skip
def test_faults_of_a_page(check_prose, sentence, rule):
    found = [name for name, _ in check_prose.faults(PAGE.format(sentence=sentence))]
    assert found == ([] if rule is None else [rule])


def test_the_readme_has_no_fault(check_prose):
    assert list(check_prose.page_faults(Path("README.md"))) == []
