"""Sets of a pool's members, fitted, and changed into other sets without a new fit.

With Σ = I + Σ_g ρ_g Z_g Z_gᵀ the covariance that a set's effects give the rows beyond the base, all that
a set says follows from H = ZᵀΣ⁻¹Z of every direction, z = ZᵀΣ⁻¹r, rᵀΣ⁻¹r and |Σ|. An effect of k directions
more, or one less, changes Σ by k directions: with s = 1 where effects are taken out, -1 where they
are put in, and R the roots of their ratios,

    L Lᵀ = I - s R H R,   W = H R L⁻ᵀ,   y = L⁻¹ R z:   H + s W Wᵀ,   z + s W y,   rᵀΣ⁻¹r + s yᵀy

(Woodbury). So the neighbours of a set cost no more than their few directions. Taking out an effect
that the data determine well costs digits, as many as its ratio has twice: of a ratio of 1e5 about six are
left, and putting it in again brings the others back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..._linalg import invert_triangle
from ..._typing import Array, Index, Mask

# share of its square that a response keeps at least
LEAST = 1e-300
# directions that may be kept apart from a set's products
APART = 48


@dataclass(frozen=True, eq=False)
class FittedSet:
    """A set of members with their variance `ratios`.

    `rows`: each member's directions among all D; H (D, D): the products beyond a set that this one was
    changed from; `more` (D, K), `signs` (K,): what the changes add, more · signs · moreᵀ; z (D,):
    products with the response; `left`: what the set leaves of its square; `price`: of the set's
    freedom, in log evidence."""

    rows: Sequence[Index]
    ratios: Mapping[int, float]
    H: Array
    more: Array
    signs: Array
    z: Array
    left: float
    price: float
    # blocks of H that were asked for; the sets that this one is changed into share them
    _known: dict[bytes, Array] = field(default_factory=dict, repr=False)

    @property
    def members(self) -> list[int]:
        """The members, in order."""
        return sorted(self.ratios)

    def take_blocks(self, rows: Index, taken: Mask | slice = slice(None)) -> Array:
        """Take the products (n, k, k) of directions (n, k), some of them, with one another beyond the
        set."""
        key = rows.tobytes()
        if key not in self._known:
            self._known[key] = self.H[rows[:, :, None], rows[:, None, :]]
        own = self.more[rows[taken]]
        signed = own * self.signs
        return np.asarray(self._known[key][taken] + np.matmul(signed, own.swapaxes(1, 2)))

    def change_into(self, ratios: Mapping[int, float]) -> FittedSet:
        """Change the set into another one: members are taken out, then others are put in."""
        out = [p for p in self.members if ratios.get(p) != self.ratios[p]]
        new = [p for p in sorted(ratios) if self.ratios.get(p) != ratios[p]]
        changed = self._change(out, self.ratios, 1.0)._change(new, ratios, -1.0)
        return replace(changed, ratios=dict(ratios))

    def gather(self) -> FittedSet:
        """Gather all changes in H, from which many sets may be reached."""
        more = self.more
        signed = more * self.signs
        H = self.H + signed @ more.T
        none = more[:, :0]
        no_signs = self.signs[:0]
        return replace(self, H=H, more=none, signs=no_signs, _known={})

    def _change(
        self, members: Sequence[int], ratios: Mapping[int, float], sign: float
    ) -> FittedSet:
        """Take members out (sign 1), or put them in (-1)."""
        if not members:
            return self
        own = np.concatenate([self.rows[p] for p in members])
        root = np.sqrt([ratios[p] for p in members for _ in self.rows[p]])
        columns = self._take_columns(own) * root
        inner = np.eye(len(own)) - sign * root[:, None] * columns[own]
        inverse = invert_triangle(np.linalg.cholesky(inner))
        W = columns @ inverse.T
        y = inverse @ (root * self.z[own])
        changed = replace(
            self,
            more=np.hstack([self.more, W]),
            signs=np.concatenate([self.signs, np.full(len(own), sign)]),
            z=self.z + sign * (W @ y),
            left=max(self.left + sign * float(y @ y), LEAST * self.left),
            price=self.price - float(np.log(np.diagonal(inverse)).sum()),
        )
        return changed if len(changed.signs) <= APART else changed.gather()

    def _take_columns(self, own: Index) -> Array:
        """Take some columns (D, k) of the products beyond the set."""
        more = self.more
        signed = more * self.signs
        changes = signed @ more[own].T
        columns = self.H[:, own]
        return np.asarray(columns + changes)
