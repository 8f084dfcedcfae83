"""`python -m relight3d` is the command line too."""

from relight3d.cli import main

raise SystemExit(main())
