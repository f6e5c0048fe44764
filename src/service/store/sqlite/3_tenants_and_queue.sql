-- Whose a session is; the queue's lanes, fairness, fences and deadlines; where the kept history of events begins.
ALTER TABLE sessions ADD COLUMN tenant TEXT NOT NULL DEFAULT 'local';
CREATE INDEX sessions_by_tenant ON sessions (tenant, id);
CREATE INDEX osteotomies_by_session ON osteotomies (session, id);
CREATE INDEX plans_by_session ON plans (session, id);

ALTER TABLE jobs ADD COLUMN tenant TEXT NOT NULL DEFAULT 'local';
ALTER TABLE jobs ADD COLUMN lane TEXT NOT NULL DEFAULT 'heavy';
ALTER TABLE jobs ADD COLUMN subject TEXT;
ALTER TABLE jobs ADD COLUMN other_session TEXT REFERENCES sessions (id) ON DELETE CASCADE;
ALTER TABLE jobs ADD COLUMN max_wall_s REAL;
ALTER TABLE jobs ADD COLUMN fence INTEGER NOT NULL DEFAULT 0;
ALTER TABLE jobs ADD COLUMN superseded_by TEXT;
ALTER TABLE jobs ADD COLUMN events_from INTEGER NOT NULL DEFAULT 1;
CREATE INDEX jobs_by_session ON jobs (session, id);
CREATE INDEX jobs_by_other_session ON jobs (other_session);
CREATE INDEX jobs_by_tenant ON jobs (tenant, id);

-- When each tenant had its last turn in a lane.
CREATE TABLE turns (
    tenant TEXT NOT NULL,
    lane TEXT NOT NULL,
    last INTEGER NOT NULL,
    PRIMARY KEY (tenant, lane)
) STRICT;

ALTER TABLE tombstones ADD COLUMN tenant TEXT NOT NULL DEFAULT 'local';

CREATE TABLE answers (
    tenant TEXT NOT NULL,
    key TEXT NOT NULL,
    request_sha256 TEXT NOT NULL,
    status INTEGER NOT NULL,
    location TEXT,
    retry_after TEXT,
    body TEXT NOT NULL,
    session TEXT,
    created_at TEXT NOT NULL,
    PRIMARY KEY (tenant, key)
) STRICT;
INSERT INTO answers (tenant, key, request_sha256, status, location, retry_after, body, session, created_at)
    SELECT 'local', key, request_sha256, status, location, retry_after, body, session, created_at FROM idempotency;
DROP TABLE idempotency;
