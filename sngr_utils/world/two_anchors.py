"""A landmark seen from two known anchors: where it may be (section "Bimodal")."""

from typing import Self

import numpy as np
from pydantic import model_validator

from sngr_utils.settings import Checked, Positive


class TwoAnchors(Checked):
    """Two anchors, a range from each, and a weak prior on the landmark midway, in m.

    The paper prints neither range_sigma nor landmark_prior_sigma. 0.2 m is what its
    log-likelihood at the saddle follows from, 10 m what its gain follows from.
    """

    anchor_distance: Positive = 4.0
    measured_range: Positive = 3.0
    range_sigma: Positive = 0.2
    landmark_prior_sigma: Positive = 10.0

    @model_validator(mode="after")
    def _has_two_places(self) -> Self:
        if self.measured_range <= self.anchor_distance / 2:
            raise ValueError(
                f"measured_range is {self.measured_range}: it must exceed half of "
                f"anchor_distance ({self.anchor_distance}), or the two circles do not cross"
            )
        if self.full_hessian(self.saddle)[1, 1] >= 0:
            raise ValueError(
                f"range_sigma is {self.range_sigma} and landmark_prior_sigma "
                f"{self.landmark_prior_sigma}: the prior must be weaker against the ranges, or "
                "the landmark has one place only, midway between the anchors"
            )
        return self

    @property
    def anchors(self) -> np.ndarray:
        """(2, 2) anchor positions, [m]"""
        return np.array([[0.0, 0.0], [self.anchor_distance, 0.0]])

    @property
    def saddle(self) -> np.ndarray:
        """(2,) the point midway between the anchors, where the landmark is started, [m]"""
        return self.anchors.mean(axis=0)

    @property
    def modes(self) -> np.ndarray:
        """(2, 2) where the circles cross, y > 0 first, [m]"""
        height = np.sqrt(self.measured_range**2 - (self.anchor_distance / 2) ** 2)
        return self.saddle + np.array([[0.0, height], [0.0, -height]])

    def gauss_newton_hessian(self, at: np.ndarray) -> np.ndarray:
        """(2, 2) J^T J of the factors: what iSAM2 sees. Ranges only see along the ray."""
        offset = at - self.anchors
        rays = offset / np.linalg.norm(offset, axis=1, keepdims=True)
        ranges = rays.T @ rays / self.range_sigma**2
        return ranges + np.eye(2) / self.landmark_prior_sigma**2

    def full_hessian(self, at: np.ndarray) -> np.ndarray:
        """(2, 2) true second derivative of the negative log posterior at a point.

        Adds to `gauss_newton_hessian` the curvature of the circles,
        (rho - z) / (rho sigma^2) (I - n n^T), n the ray and rho the distance; negative inside a
        circle.
        """
        hessian = self.gauss_newton_hessian(at)
        for offset in at - self.anchors:
            distance = np.linalg.norm(offset)
            ray = offset / distance
            curvature = (distance - self.measured_range) / (distance * self.range_sigma**2)
            hessian += curvature * (np.eye(2) - np.outer(ray, ray))
        return hessian

    def profile(self, y: np.ndarray, factor: float) -> np.ndarray:
        """(N,) log-likelihood of the ranges alone on the line through both modes, [nats].

        Parameters
        ----------
        y : (N,) heights above the anchors' line, [m]
        factor : factor on GTSAM's error(), see `settings.SamplerSettings`
        """
        distance = np.hypot(self.anchor_distance / 2, y)
        error = (distance - self.measured_range) ** 2 / (2 * self.range_sigma**2)
        return -factor * 2 * error
