-- Values that are stored from now on end in a seal, which earlier versions would take for content: the number keeps those out.
SELECT 1;
