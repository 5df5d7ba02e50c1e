"""The controlled bed as matrices and frequency responses: what the search checks its ends and states its errors by."""
