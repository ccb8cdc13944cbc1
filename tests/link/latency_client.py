"""A solid of N nodes without physics in Python: for the latency of an exchange. See latency.py."""
import sys

import undine_link

undine_link.arm("solid", 20.0)

import numpy as np  # noqa: E402

n = int(sys.argv[1])
with undine_link.Link("solid", "latency in Python", 20.0, 20.0) as link:
    link.receive_setup()
    x = np.stack([np.arange(n), np.zeros(n)], axis=1).astype(float)
    link.set_nodes(x, np.ones(n))
    link.add_faces("line", [[k, k + 1] for k in range(n - 1)])
    link.send_surface()
    link.send_report(1e-3)
    for window in link.windows():
        if window.activate:
            link.activate(x, x)
        for _ in range(window.steps if window.fine else 1):
            link.exchange(x)
        link.send_report(1e-3)
