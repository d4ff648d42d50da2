"""Any capture file to valid packets in order, with a ledger of every byte."""
