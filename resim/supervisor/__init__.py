"""The Supervisor: what runs, what failed, what there is, in a browser. A thin layer over jobs and results."""
