"""The command line: parsing and printing only.

Every verb is one module with ``NAME``, ``HELP``, ``add_arguments(parser)`` and ``run(arguments) -> int``, listed in
`kiteocp.cli.main`. What a verb needs is imported inside ``run``, so that ``kiteocp --help`` stays fast.
"""
