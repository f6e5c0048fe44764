-- The waiting jobs of each tenant in their order, for claims.
CREATE INDEX jobs_in_line ON jobs (lane, tenant, number) WHERE state = 'accepted' AND cancel_requested_at IS NULL;
