"""Machine code is kept apart for each state of the compiled sources."""

from sngr_utils.numerics import jit

COMPILED = "@compile_once\ndef f(x): return x"


def test_fingerprint_changes_with_compiled_code_in_any_folder(tmp_path):
    deep = tmp_path / "slam/deep"
    deep.mkdir(parents=True)
    for path in (tmp_path / "a.py", tmp_path / "slam/b.py", deep / "c.py"):
        path.write_text(COMPILED)
    (deep / "plain.py").write_text("x = 1")
    before = jit.fingerprint(tmp_path)
    (deep / "plain.py").write_text("x = 2")
    assert jit.fingerprint(tmp_path) == before
    (deep / "c.py").rename(tmp_path / "d.py")
    assert jit.fingerprint(tmp_path) == before
    for path in (tmp_path / "a.py", tmp_path / "slam/b.py", tmp_path / "d.py"):
        path.write_text(COMPILED + " + 1")
        assert jit.fingerprint(tmp_path) != before
        path.write_text(COMPILED)
