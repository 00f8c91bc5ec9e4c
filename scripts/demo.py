"""The demonstration behind `make demo`: python scripts/demo.py [--out runs/demo] ..."""

import sys
from dataclasses import fields

from marl_cair.cli import EXIT_DONE, EXIT_INTERRUPTED, EXIT_REFUSED
from marl_cair.cli.parser import Parser
from marl_cair.training.demo import NEXT, DemoSettings, run_demo
from marl_cair.training.settings.options import read_comments


def main() -> int:
    """Run it as the command line says; returns the exit code."""
    parser = Parser(description=__doc__)
    comments = read_comments(DemoSettings)
    for field in fields(DemoSettings):
        name, kind = field.name.replace("_", "-"), type(field.default)
        shown = f"{comments[field.name]} (default: {field.default})"
        parser.add_argument(f"--{name}", type=kind, default=field.default, help=shown)
    settings = DemoSettings(**vars(parser.parse_args()))
    try:
        run_demo(settings)
    except KeyboardInterrupt:
        print(f"interrupted: run the same command again to go on in {settings.out}")
        return EXIT_INTERRUPTED
    except (ValueError, OSError) as error:
        print(f"demo: {error}", file=sys.stderr)
        return EXIT_REFUSED
    print(NEXT.format(out=settings.out))
    return EXIT_DONE


if __name__ == "__main__":
    sys.exit(main())
