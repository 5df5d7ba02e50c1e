"""Verification of a tuned case: poles, encirclements, simulation, responses, and all of it by an independent method.

It shares nothing with the CasADi programme. With the search, which accepts ends by poles and encirclements, it shares
:mod:`matching.frequency.loop`; :mod:`matching.frequency.independent` shares nothing with either.
"""
