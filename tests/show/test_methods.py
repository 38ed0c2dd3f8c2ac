from sngr_utils.experiments import estimators, online_variants
from sngr_utils.show import methods


def test_every_method_has_one_name_and_one_look():
    found = methods.METHODS
    assert set(found) == {*estimators.METHODS, online_variants.NAME}
    assert len({method.name for method in found.values()}) == len(found)
    looks = {(method.colour, method.dash, method.marker) for method in found.values()}
    assert len(looks) == len(found)
    assert methods.shown("em_exclusive") == "EM, exclusive"
    assert methods.shown("first_poses") == "first poses"
