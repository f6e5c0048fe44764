-- Until when a running job is its worker's, and since when a job waits: ms since 1970 by the database's clock.
ALTER TABLE jobs ADD COLUMN lease_until BIGINT, ADD COLUMN waits_since BIGINT;
-- The process that began it last.
ALTER TABLE jobs ADD COLUMN worker TEXT COLLATE "C";

-- Every process is told when a job can be begun ('queue'), and of new events, of jobs that shall stop, and of sessions that are gone.
CREATE FUNCTION tell() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    PERFORM pg_notify('prosopon', TG_ARGV[0]);
    RETURN NULL;
END $$;
CREATE TRIGGER told_new AFTER INSERT ON jobs FOR EACH STATEMENT EXECUTE FUNCTION tell('queue');
CREATE TRIGGER told_again AFTER UPDATE OF state ON jobs FOR EACH ROW WHEN (NEW.state = 'accepted') EXECUTE FUNCTION tell('queue');
CREATE TRIGGER told AFTER INSERT ON events FOR EACH STATEMENT EXECUTE FUNCTION tell('');
CREATE TRIGGER told AFTER UPDATE OF cancel_requested_at ON jobs FOR EACH STATEMENT EXECUTE FUNCTION tell('');
CREATE TRIGGER told AFTER DELETE ON sessions FOR EACH STATEMENT EXECUTE FUNCTION tell('');
