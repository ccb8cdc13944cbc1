#!/usr/bin/python3
"""The first mode of water on an elastic bed: its frequency, its fields for case.toml, mode.csv beside this file.

    cases/elastic_bed/reference/mode.py

Water 0 < y - D < H, bed 0 < y < D. All fields go with C = cos(KX x) cos(KZ z), K^2 = KX^2 + KZ^2, and sin or cos of omega t.

    water  v = grad(F sinh(k (D + H - y)) C),  k^2 = K^2 - (omega/c)^2:                     p = 0 at its top
    bed    u = grad(A cosh(P y) C) + (q B cos(q y) grad_h C, K^2 B sin(q y) C),             u_y = 0, no shear at its bottom
           P^2 = K^2 - (omega/c_p)^2, q^2 = (omega/c_s)^2 - K^2

No shear at y = D gives B, equal u_y there gives F, and sigma_yy = -p the equation for omega (a plate's of Rayleigh and Lamb, loaded by water).
"""
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

LENGTH, D, H = 1.0, 0.25, 0.25           # m
RHO, C = 1000.0, np.sqrt(2.2e9 / 1000.0)
RHO_BED, E, NU = 1100.0, 2e8, 0.4
V = 0.01                                 # m/s, of the wet surface at its corner
KX = KZ = np.pi / LENGTH
K = np.hypot(KX, KZ)
MU = E / (2.0 * (1.0 + NU))
C_S, C_P = np.sqrt(MU / RHO_BED), np.sqrt(2.0 * MU * (1.0 - NU) / (1.0 - 2.0 * NU) / RHO_BED)


def bed(omega):
    """P, q and B for A = 1, u_y and sigma_yy at the top. (P is imaginary beyond c_p K, q below c_s K.)"""
    P, q = np.emath.sqrt(K**2 - (omega / C_P)**2), np.emath.sqrt((omega / C_S)**2 - K**2)
    B = -2.0 * P * np.sinh(P * D) / ((K**2 - q**2) * np.sin(q * D))
    u = P * np.sinh(P * D) + K**2 * B * np.sin(q * D)
    sigma = MU * ((K**2 - q**2) * np.cosh(P * D) + 2.0 * K**2 * q * B * np.cos(q * D))
    return P, q, B, u, sigma


def imbalance(omega):
    _, _, _, u, sigma = bed(omega)
    k = np.sqrt(K**2 - (omega / C)**2)
    return (sigma / u - RHO * omega**2 * np.tanh(k * H) / k).real


def main():
    at = np.linspace(1.0, C_P * K, 1000)
    first = next(i for i in range(len(at)) if imbalance(at[i]) > 0.0 >= imbalance(at[i + 1]))
    omega = brentq(imbalance, at[first], at[first + 1], xtol=1e-9)
    assert abs(imbalance(omega)) < 1e-6 * imbalance(1.0)
    P, q, B, u, _ = bed(omega)
    k = np.sqrt(K**2 - (omega / C)**2)
    F, A = -V / (k * np.cosh(k * H)), V / u
    print(f"omega {omega:.6f} 1/s, period {2.0 * np.pi / omega:.6e} s, P {P:.7f}, q {q:.7f}, k {k:.7f} 1/m")
    print(f"water: v_y -k F {-k * F:.9e}, v_x and v_z -KX F {-KX * F:.9e}")
    print(f"bed: v_y P A {P * A:.9e}, K^2 A B {K**2 * A * B:.9e}; v_x and v_z -KX A {-KX * A:.9e}, -KX q A B {-KX * q * A * B:.9e}")
    t = np.linspace(0.0, 2.0 * np.pi / omega, 201)
    rows = "\n".join(f"{a:.7e},{V / omega * np.sin(omega * a):.9e}" for a in t)
    Path(__file__).with_name("mode.csv").write_text(
        f"# first mode of water on an elastic bed, exact (mode.py): omega = {omega:.4f} 1/s; u_y at the corner of the wet surface\n"
        f"t_s,u_y_m\n{rows}\n")


if __name__ == "__main__":
    main()
