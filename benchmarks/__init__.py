"""What kiteocp costs on this machine: ``python -m benchmarks`` prints it.

``python -m benchmarks.readme`` refreshes what README shows of the program.
Nothing here is a test: a time depends on the machine. A new line goes into the module of its group.
"""
