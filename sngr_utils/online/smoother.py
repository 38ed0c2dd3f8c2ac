"""iSAM2 with factors that have names, so that they can be taken out again.

GTSAM knows a factor by its slot. Here it has a name, and an update says which names to remove
and which factors to add: ``("range", m)``, ``("odometry", t)``, ``("landmark", k)``, ``("x0",)``.
A variable whose last factor goes, goes with it.
"""

import gtsam

Name = tuple[str, int] | tuple[str]
RELINEARIZE_THRESHOLD = 0.01  # m and rad: a swapped factor asks for more care than the usual 0.1


class Smoother:
    """One iSAM2 object and the slots of its factors."""

    def __init__(self) -> None:
        params = gtsam.ISAM2Params()
        params.setRelinearizeThreshold(RELINEARIZE_THRESHOLD)
        params.relinearizeSkip = 1
        self._isam = gtsam.ISAM2(params)
        self._slots: dict[Name, int] = {}
        self._factors: dict[Name, gtsam.NonlinearFactor] = {}
        self.values = gtsam.Values()

    def update(
        self,
        added: dict[Name, gtsam.NonlinearFactor],
        removed: list[Name] | None = None,
        start: gtsam.Values | None = None,
    ) -> None:
        """Remove and add factors, new variables starting from `start`, and re-estimate.

        A name that is added and there already is replaced.

        Raises
        ------
        KeyError : a name to be removed that is not there
        """
        gone = dict.fromkeys([*(removed or []), *(n for n in added if n in self._slots)])
        slots = [self._slots.pop(name) for name in gone]
        for name in gone:
            del self._factors[name]
        factors = gtsam.NonlinearFactorGraph()
        for factor in added.values():
            factors.push_back(factor)
        result = self._isam.update(factors, start or gtsam.Values(), slots)
        self._slots.update(zip(added, result.getNewFactorsIndices(), strict=True))
        self._factors.update(added)
        self.values = self._isam.calculateEstimate()

    def settle(self, updates: int) -> None:
        """Updates without new factors: Gauss-Newton steps for what still moves."""
        for _ in range(updates):
            self._isam.update()
        self.values = self._isam.calculateEstimate()

    def named(self, kind: str) -> dict[Name, gtsam.NonlinearFactor]:
        """The factors of one kind by name."""
        return {name: factor for name, factor in self._factors.items() if name[0] == kind}

    def factors(self, *kinds: str) -> gtsam.NonlinearFactorGraph:
        """The factors of some kinds."""
        found = gtsam.NonlinearFactorGraph()
        for kind in kinds:
            for factor in self.named(kind).values():
                found.push_back(factor)
        return found
