"""Printed and known targets as features of the map."""
