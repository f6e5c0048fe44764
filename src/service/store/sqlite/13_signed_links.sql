-- Secret that signs links to single results, shared by all processes; NULL until the first link.
ALTER TABLE store ADD COLUMN link_key TEXT;
