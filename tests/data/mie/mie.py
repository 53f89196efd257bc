#!/usr/bin/env python3
"""Phase functions of water droplets by Mie theory: the reference of the fit, and a table for users.

Algorithm: Bohren and Huffman, Absorption and Scattering of Light by Small Particles, 1983, appendix A (BHMIE): logarithmic derivatives by
downward recurrence, Riccati-Bessel functions by upward recurrence, x + 4 x^(1/3) + 2 terms. Checked against their printed
case (m = 1.55, x = 5.2128: Q_ext = 3.10543, Q_sca = 3.10543, Q_back = 2.92534) before anything is written.

Water: m = 1.33, no absorption. Wavelengths: 400 to 700 nm, weighted equally, each by its scattering cross-section.
Droplets: gamma distribution n(r) ~ r^((1-3b)/b) exp(-r/(ab)) of Hansen and Travis 1974 with effective radius a and effective variance b.

    python3 mie.py            writes mie_water.csv beside this file, scenes/phase/*.csv and the figure of the book
"""
import math
import pathlib
import numpy as np

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[2]
M = 1.33
VARIANCE = 0.02


def coefficients(x, m=M):
    """Mie coefficients a_n, b_n of a sphere without absorption."""
    terms = int(x + 4.0 * x ** (1 / 3) + 2.0)
    y = x * m
    start = int(max(terms, y)) + 16
    d = np.zeros(start + 1)
    for n in range(start, 0, -1):
        d[n - 1] = n / y - 1.0 / (d[n] + n / y)
    psi0, psi1 = math.cos(x), math.sin(x)
    chi0, chi1 = -math.sin(x), math.cos(x)
    a = np.zeros(terms, complex)
    b = np.zeros(terms, complex)
    for n in range(1, terms + 1):
        psi = (2 * n - 1) * psi1 / x - psi0
        chi = (2 * n - 1) * chi1 / x - chi0
        xi, xi1 = complex(psi, -chi), complex(psi1, -chi1)
        s = d[n] / m + n / x
        a[n - 1] = (s * psi - psi1) / (s * xi - xi1)
        s = d[n] * m + n / x
        b[n - 1] = (s * psi - psi1) / (s * xi - xi1)
        psi0, psi1, chi0, chi1 = psi1, psi, chi1, chi
    return a, b


class Angles:
    """pi_n and tau_n at fixed cosines, for all orders up to `terms`."""

    def __init__(self, mu, terms):
        self.pi = np.zeros((terms + 1, len(mu)))
        self.tau = np.zeros((terms + 1, len(mu)))
        self.pi[1] = 1.0
        for n in range(1, terms + 1):
            if n > 1:
                before = self.pi[n - 2]
                self.pi[n] = ((2 * n - 1) * mu * self.pi[n - 1] - n * before) / (n - 1)
            self.tau[n] = n * mu * self.pi[n] - (n + 1) * self.pi[n - 1]


def intensity(x, angles, m=M):
    """(|S1|^2 + |S2|^2) / 2 at the angles, and sum (2n+1)(|a|^2+|b|^2)."""
    a, b = coefficients(x, m)
    n = np.arange(1, len(a) + 1)
    factor = (2 * n + 1) / (n * (n + 1))
    pi, tau = angles.pi[1 : len(a) + 1], angles.tau[1 : len(a) + 1]
    s1 = (factor * a) @ pi + (factor * b) @ tau
    s2 = (factor * a) @ tau + (factor * b) @ pi
    return 0.5 * (abs(s1) ** 2 + abs(s2) ** 2), float(((2 * n + 1) * (abs(a) ** 2 + abs(b) ** 2)).sum()), (a, b)


def check():
    x, m = 2 * math.pi * 0.525 / 0.6328, 1.55
    a, b = coefficients(x, m)
    n = np.arange(1, len(a) + 1)
    ext = 2 / x**2 * ((2 * n + 1) * (a + b).real).sum()
    sca = 2 / x**2 * ((2 * n + 1) * (abs(a) ** 2 + abs(b) ** 2)).sum()
    back = abs(((2 * n + 1) * (-1) ** n * (a - b)).sum()) ** 2 / x**2
    assert abs(ext - 3.10543) < 1e-5 and abs(sca - 3.10543) < 1e-5, (ext, sca)
    assert abs(back - 2.92534) < 1e-5, back


def phase(diameter, degrees, wavelengths=24, radii=96, variance=VARIANCE):
    """Phase function, 1/sr, of droplets of effective diameter `diameter` (micrometres), and its mean cosine by quadrature in the series."""
    mu = np.cos(np.radians(degrees))
    a_eff = diameter / 2
    spread = 4 * math.sqrt(variance)
    r = a_eff * np.linspace(max(0.05, 1 - spread), 1 + 1.4 * spread, radii)
    weight = (r / a_eff) ** ((1 - 3 * variance) / variance) * np.exp(-r / (a_eff * variance) + 1 / variance)
    lam = np.linspace(0.4, 0.7, wavelengths)
    largest = 2 * math.pi * r[-1] / lam[0]
    angles = Angles(mu, int(largest + 4 * largest ** (1 / 3) + 4))
    total = np.zeros_like(mu)
    sca = cosine = 0.0
    for wavelength in lam:
        k = 2 * math.pi / wavelength
        for radius, w in zip(r, weight):
            if w < 1e-7 * weight.max():
                continue
            i, q, (a, b) = intensity(k * radius, angles)
            total += w * i / k**2
            # Cross-section: (2 pi / k^2) q.
            sca += w * 2 * math.pi / k**2 * q
            n = np.arange(1, len(a) + 1)
            a1, b1 = np.append(a[1:], 0), np.append(b[1:], 0)
            g = (n * (n + 2) / (n + 1) * (a * a1.conj() + b * b1.conj()).real + (2 * n + 1) / (n * (n + 1)) * (a * b.conj()).real).sum()
            cosine += w * 4 * math.pi / k**2 * g
    return total / sca, cosine / sca


def grid():
    """Angles dense where droplets need them: the forward peak, the fog bow, the glory."""
    return np.unique(np.concatenate([
        np.arange(0, 2, 0.1), np.arange(2, 10, 0.25), np.arange(10, 130, 1.0), np.arange(130, 170, 0.5), np.arange(170, 180.01, 0.1)]).round(4))


def write(path, degrees, values, diameter, g):
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "w") as out:
        out.write(f"# Water droplets (m = 1.33), effective diameter {diameter} micrometres, effective variance {VARIANCE}, 400 to 700 nm.\n")
        out.write(f"# Mie theory by BHMIE (Bohren and Huffman 1983); mean cosine {g:.5f}. Made by tests/data/mie/mie.py.\n")
        out.write("# scattering angle in degrees, phase function in 1/sr\n")
        for angle, value in zip(degrees, values):
            out.write(f"{angle:g},{value:.5e}\n")


def fit(d, degrees):
    """Jendersie and d'Eon 2023 for 5 to 50 micrometres."""
    g_hg = math.exp(-0.0990567 / (d - 1.67154))
    g_d = math.exp(-2.20679 / (d + 3.91029) - 0.428934)
    alpha = math.exp(3.62489 - 8.29288 / (d + 5.52825))
    w_d = math.exp(-0.599085 / (d - 0.641583) - 0.665888)
    c = np.cos(np.radians(degrees))
    x = 2 * np.sin(np.radians(degrees) / 2) ** 2
    hg = lambda g: (1 - g * g) / (4 * math.pi * ((1 - g) ** 2 + 2 * g * x) ** 1.5)
    return (1 - w_d) * hg(g_hg) + w_d * hg(g_d) * (1 + alpha * c * c) / (1 + alpha * (1 + 2 * g_d * g_d) / 3)


def figure(path, degrees, curves):
    """Three panels, one per diameter: Mie (solid) and fit (dashed), logarithmic."""
    width, height, left, top, low, high = 300, 260, 52, 34, -3.0, 3.0
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {3 * (width + left) + 12} {height + 84}" font-family="sans-serif" font-size="12">',
           '<rect width="100%" height="100%" fill="white"/>']
    for panel, (diameter, mie) in enumerate(curves):
        x0 = left + panel * (width + left)
        px = lambda a: x0 + a / 180 * width
        py = lambda v: top + (high - np.clip(np.log10(v), low, high)) / (high - low) * height
        out.append(f'<text x="{x0 + width / 2}" y="{top - 12}" text-anchor="middle">{diameter:g} \u00b5m</text>')
        for power in range(int(low), int(high) + 1):
            y = py(10.0**power)
            out.append(f'<line x1="{x0}" x2="{x0 + width}" y1="{y:.1f}" y2="{y:.1f}" stroke="#ddd"/><text x="{x0 - 6}" y="{y + 4:.1f}" text-anchor="end">1e{power}</text>')
        for angle in range(0, 181, 30):
            out.append(f'<line x1="{px(angle):.1f}" x2="{px(angle):.1f}" y1="{top}" y2="{top + height}" stroke="#ddd"/><text x="{px(angle):.1f}" y="{top + height + 16}" text-anchor="middle">{angle}</text>')
        for values, style in [(mie, 'stroke="#1f5fa8"'), (fit(diameter, degrees), 'stroke="#c04a1c" stroke-dasharray="6 4"')]:
            points = " ".join(f"{px(a):.1f},{py(v):.1f}" for a, v in zip(degrees, values))
            out.append(f'<polyline points="{points}" fill="none" stroke-width="1.6" {style}/>')
    y = top + height + 40
    out.append(f'<text x="{left}" y="{y}">scattering angle in degrees; phase function in 1/sr</text>')
    out.append(f'<line x1="{left}" x2="{left + 30}" y1="{y + 20}" y2="{y + 20}" stroke="#1f5fa8" stroke-width="1.6"/><text x="{left + 36}" y="{y + 24}">Mie theory</text>')
    out.append(f'<line x1="{left + 130}" x2="{left + 160}" y1="{y + 20}" y2="{y + 20}" stroke="#c04a1c" stroke-width="1.6" stroke-dasharray="6 4"/><text x="{left + 166}" y="{y + 24}">fit</text></svg>')
    path.write_text("\n".join(out) + "\n", encoding="utf-8")


def main():
    check()
    degrees = grid()
    rows = {}
    for diameter in [0.1, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0]:
        many = diameter <= 20
        values, g = phase(diameter, degrees, 24 if many else 16, 96 if many else 64)
        x = 2 * np.sin(np.radians(degrees) / 2) ** 2
        norm = 2 * math.pi * np.trapezoid(values, x)
        print(f"diameter {diameter}: g {g:.5f}, trapezoid integral {norm:.4f}, largest {values[0]:.1f}", flush=True)
        rows[diameter] = (values, g)
        if diameter in (10.0, 20.0):
            write(ROOT / "scenes" / "phase" / f"water_{diameter:g}um.csv", degrees, values, diameter, g)
    figure(ROOT / "docs/book/src/images/phase-mie.svg", degrees, [(d, rows[d][0]) for d in (5.0, 10.0, 20.0)])
    with open(HERE / "mie_water.csv", "w") as out:
        out.write("# Phase functions of water droplets, 1/sr, made by mie.py: see there. First rows: effective diameter in micrometres, mean cosine.\n")
        out.write("diameter," + ",".join(f"{d:g}" for d in rows) + "\n")
        out.write("mean_cosine," + ",".join(f"{g:.6f}" for _, g in rows.values()) + "\n")
        keep = [i for i, d in enumerate(degrees) if d % 1 == 0 or d < 5 and round(d * 4, 6) % 1 == 0]
        for i in keep:
            out.write(f"{degrees[i]:g}," + ",".join(f"{v[i]:.5e}" for v, _ in rows.values()) + "\n")


if __name__ == "__main__":
    main()
