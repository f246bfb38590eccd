"""The quasi-steady model of a pumping kite, written once as symbolic expressions.

Every function takes floats or CasADi matrices, of numbers or symbols, and returns the same kind; lengths are in m,
forces in N, speeds in m/s, angles in rad. Equation labels are those of van der Vlugt, Bley, Noom and Schmehl,
*Quasi-steady model of a pumping kite power system*, Renewable Energy 131 (2019).
"""
