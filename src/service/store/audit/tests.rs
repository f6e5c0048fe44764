use super::*;

fn entry(who: &str) -> AuditEntry {
    AuditEntry { who: who.to_owned(), what: "GET /v1/sessions".to_owned(), status: 200, ..AuditEntry::default() }
}

fn entries(data: &Path) -> usize {
    Audit::verify(data, None).unwrap().entries
}

fn only_file(data: &Path) -> PathBuf {
    files(&data.join("audit")).unwrap().pop().unwrap()
}

#[test]
fn entries_are_chained_across_restarts_and_a_changed_or_removed_one_shows() {
    let data = tempfile::tempdir().unwrap();
    for who in ["a", "b"] {
        let audit = Audit::open(data.path()).unwrap();
        audit.record(entry(who), false).unwrap();
        audit.record(entry(who), true).unwrap();
    }
    assert_eq!(entries(data.path()), 4);
    let path = only_file(data.path());
    let whole = std::fs::read_to_string(&path).unwrap();
    assert!(whole.contains(r#""who":"a""#) && whole.lines().count() == 4);

    std::fs::write(&path, whole.replacen(r#""who":"b""#, r#""who":"x""#, 1)).unwrap();
    assert!(matches!(Audit::verify(data.path(), None), Err(AuditFault::Broken { line: 3, .. })));
    let without_second: Vec<&str> = whole.lines().enumerate().filter(|(i, _)| *i != 1).map(|(_, l)| l).collect();
    std::fs::write(&path, without_second.join("\n")).unwrap();
    assert!(matches!(Audit::verify(data.path(), None), Err(AuditFault::Broken { line: 2, .. })));
}

#[tokio::test]
async fn a_tail_that_was_cut_off_shows_up_to_the_noted_end() {
    let data = tempfile::tempdir().unwrap();
    assert!(matches!(verify_audit(data.path(), None).await, Err(AuditFault::Missing { .. })));
    let store = super::super::Store::open(data.path()).await.unwrap();
    let audit = Audit::open(data.path()).unwrap();
    assert_eq!(audit.settle().unwrap(), None);
    for who in ["a", "b", "c"] {
        audit.record(entry(who), false).unwrap();
    }
    let end = audit.settle().unwrap().unwrap();
    store.set_audit_anchor(&end).await.unwrap();
    audit.record(entry("d"), false).unwrap();
    store.close().await;
    let report = verify_audit(data.path(), None).await.unwrap();
    assert_eq!((report.entries, report.later, report.anchored_at.is_some()), (4, 1, true));
    let path = only_file(data.path());
    let whole = std::fs::read_to_string(&path).unwrap();
    let first = |n: usize| whole.lines().take(n).map(|l| format!("{l}\n")).collect::<String>();
    std::fs::write(&path, first(3)).unwrap();
    assert_eq!(
        verify_audit(data.path(), None).await.unwrap().later,
        0,
        "removals after the recorded end are not found"
    );
    std::fs::write(&path, first(2)).unwrap();
    assert!(matches!(verify_audit(data.path(), None).await, Err(AuditFault::CutOff { entries: 2, .. })));
    std::fs::remove_dir_all(data.path().join("audit")).unwrap();
    assert!(matches!(verify_audit(data.path(), None).await, Err(AuditFault::CutOff { entries: 0, .. })));
}

/// A full disk leaves half a line; the log says so, and how many entries it lost.
#[test]
fn entries_that_a_full_disk_refused_are_counted() {
    let data = tempfile::tempdir().unwrap();
    let audit = Audit::open(data.path()).unwrap();
    audit.record(entry("a"), true).unwrap();
    let path = only_file(data.path());
    let whole = std::fs::metadata(&path).unwrap().len();
    OpenOptions::new().append(true).open(&path).unwrap().write_all(br#"{"entry":{"at":"20"#).unwrap();
    for _ in 0..2 {
        // Writes to a file that is open for reading fail.
        audit.state.lock().unwrap().file = Some(File::open(&path).unwrap());
        audit.record(entry("b"), false).unwrap_err();
    }
    audit.record(entry("c"), true).unwrap();
    audit.record(entry("d"), true).unwrap();
    // The first entry, the one on what was lost, and the last two.
    assert_eq!(entries(data.path()), 4);
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text[whole as usize..].contains("2 entries before this one could not be written"), "{text}");
}

#[test]
fn a_line_that_a_crash_cut_off_breaks_nothing() {
    let data = tempfile::tempdir().unwrap();
    Audit::open(data.path()).unwrap().record(entry("a"), false).unwrap();
    let path = only_file(data.path());
    let mut file = OpenOptions::new().append(true).open(&path).unwrap();
    file.write_all(br#"{"entry":{"at":"20"#).unwrap();
    drop(file);
    Audit::open(data.path()).unwrap().record(entry("b"), false).unwrap();
    assert_eq!(entries(data.path()), 2);
}

fn at(audit: &Audit, who: &str, time: &str) {
    audit.record_at(|| format!("{time}T00:00:00.000Z"), entry(who), true).unwrap();
}

/// Name and number of lines of each file.
fn lines(data: &Path) -> Vec<(String, usize)> {
    let name = |path: &Path| path.file_name().unwrap().to_str().unwrap().to_owned();
    let count = |path: &Path| std::fs::read_to_string(path).unwrap().lines().count();
    files(&data.join("audit")).unwrap().iter().map(|path| (name(path), count(path))).collect()
}

#[test]
fn a_clock_that_is_set_over_months_breaks_no_chain_and_is_noted() {
    let data = tempfile::tempdir().unwrap();
    // Each time is that of a start.
    for time in ["2026-10-30", "2026-11-02", "2026-09-01", "2026-08-31", "2027-12-05", "2026-11-03", "2028-01-01"] {
        let audit = Audit::open(data.path()).unwrap();
        at(&audit, "a", time);
        at(&audit, "b", time);
    }
    let files = [("2026-10", 2), ("2026-11", 6), ("2027-12", 4), ("2028-01", 2)];
    assert_eq!(lines(data.path()), files.map(|(month, n)| (format!("{month}.jsonl"), n)));
    let report = Audit::verify(data.path(), None).unwrap();
    assert_eq!((report.entries, report.branches), (14, 0));
    let set_back: Vec<_> = report.set_back.iter().map(|s| (&s.from[..10], &s.to[..10], s.line)).collect();
    let expected = [("2026-11-02", "2026-09-01", 3), ("2026-09-01", "2026-08-31", 5), ("2027-12-05", "2026-11-03", 3)];
    assert_eq!(set_back, expected);
}

/// Writes a log as earlier versions did: the file is that of the clock, whatever was the last one.
fn written_by_the_clock(data: &Path, entries: &[(&str, bool)]) {
    std::fs::create_dir_all(data.join("audit")).unwrap();
    let (mut chain, mut last) = (String::new(), std::collections::BTreeMap::new());
    for (time, is_start) in entries {
        if *is_start {
            chain = last.last_key_value().map(|(_, chain): (&String, &String)| chain.clone()).unwrap_or_default();
        }
        let entry = AuditEntry { at: format!("{time}T00:00:00.000Z"), ..entry("a") };
        chain = chained(&chain, &entry).unwrap();
        let path = data.join("audit").join(format!("{}.jsonl", &time[..7]));
        let line = serde_json::to_string(&Line { entry, chain: chain.clone() }).unwrap();
        let mut file = OpenOptions::new().create(true).append(true).open(path).unwrap();
        writeln!(file, "{line}").unwrap();
        last.insert(time[..7].to_owned(), chain.clone());
    }
}

#[test]
fn a_log_whose_chain_goes_back_to_an_earlier_file_verifies_and_goes_on() {
    let data = tempfile::tempdir().unwrap();
    let times = ["2026-10-30", "2026-11-02", "2026-10-31", "2026-11-04", "2027-12-05", "2026-10-01"];
    written_by_the_clock(data.path(), &times.map(|time| (time, false)));
    assert_eq!(entries(data.path()), 6);
    for who in ["b", "c"] {
        at(&Audit::open(data.path()).unwrap(), who, "2026-10-02");
    }
    let report = Audit::verify(data.path(), None).unwrap();
    assert_eq!((report.entries, report.branches, report.set_back.len()), (8, 0, 2));
    assert_eq!(lines(data.path())[2], ("2027-12.jsonl".to_owned(), 3), "the file of the latest month goes on");
}

#[test]
fn starts_of_earlier_versions_with_a_clock_that_was_set_back_are_noted() {
    let data = tempfile::tempdir().unwrap();
    let days = [("2026-11-02", true), ("2026-10-30", false), ("2026-10-31", true), ("2026-11-03", false)];
    written_by_the_clock(data.path(), &days);
    let report = Audit::verify(data.path(), None).unwrap();
    assert_eq!((report.entries, report.branches, report.set_back.len()), (4, 1, 1));
    at(&Audit::open(data.path()).unwrap(), "b", "2026-11-04");
    assert_eq!(Audit::verify(data.path(), None).unwrap().branches, 1);
}

/// Each change of a log, of which the clock was set back or not, shows.
#[test]
fn every_change_shows_with_and_without_a_clock_that_was_set_back() {
    let in_order = ["2026-10-30", "2026-10-31", "2026-11-02", "2026-11-03", "2026-12-01", "2026-12-02"];
    let set_back = ["2026-10-30", "2026-11-02", "2026-10-31", "2026-11-03", "2026-12-01", "2026-10-01"];
    for times in [in_order, set_back] {
        let original = tempfile::tempdir().unwrap();
        written_by_the_clock(original.path(), &times.map(|time| (time, false)));
        let paths = files(&original.path().join("audit")).unwrap();
        let texts: Vec<String> = paths.iter().map(|path| std::fs::read_to_string(path).unwrap()).collect();
        let broken = |texts: &[Option<String>]| {
            let data = tempfile::tempdir().unwrap();
            std::fs::create_dir(data.path().join("audit")).unwrap();
            for (path, text) in paths.iter().zip(texts) {
                let path = data.path().join("audit").join(path.file_name().unwrap());
                text.iter().for_each(|text| std::fs::write(&path, text).unwrap());
            }
            // The store recorded the end.
            let end = walk::end(&paths).unwrap();
            let is_whole = Audit::verify(data.path(), Some((end.clone(), String::new())));
            // A start that does not see the change does not mend it.
            at(&Audit::open(data.path()).unwrap(), "b", "2026-12-03");
            let again = Audit::verify(data.path(), Some((end, String::new())));
            is_whole.is_err() && again.is_err()
        };
        let whole: Vec<Option<String>> = texts.iter().cloned().map(Some).collect();
        assert!(!broken(&whole));
        for (file, text) in texts.iter().enumerate() {
            let with = |text: Option<String>| {
                let mut changed = whole.clone();
                changed[file] = text;
                changed
            };
            assert!(broken(&with(None)), "file {file} removed");
            assert!(broken(&with(Some(text.replace("\"who\":\"a\"", "\"who\":\"b\"")))), "file {file} changed");
            let lines: Vec<&str> = text.lines().collect();
            for line in 0..lines.len() {
                let without: String =
                    lines.iter().enumerate().filter(|(i, _)| *i != line).map(|(_, l)| format!("{l}\n")).collect();
                assert!(broken(&with(Some(without))), "line {line} of file {file} removed");
                let twice = format!("{text}{}\n", lines[line]);
                assert!(broken(&with(Some(twice))), "line {line} of file {file} again");
            }
            if lines.len() > 1 {
                let reversed: String = lines.iter().rev().map(|l| format!("{l}\n")).collect();
                assert!(broken(&with(Some(reversed))), "file {file} reversed");
            }
        }
    }
}

#[test]
fn a_line_that_is_no_text_is_named() {
    let data = tempfile::tempdir().unwrap();
    let audit = Audit::open(data.path()).unwrap();
    audit.record(entry("a"), false).unwrap();
    audit.record(entry("b"), false).unwrap();
    let path = only_file(data.path());
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[20] = 0xff;
    std::fs::write(&path, bytes).unwrap();
    assert!(matches!(Audit::verify(data.path(), None), Err(AuditFault::Broken { line: 1, .. })));
}

#[test]
fn a_line_that_a_crash_cut_off_is_no_change_before_the_next_start_either() {
    let data = tempfile::tempdir().unwrap();
    Audit::open(data.path()).unwrap().record(entry("a"), false).unwrap();
    let mut file = OpenOptions::new().append(true).open(only_file(data.path())).unwrap();
    file.write_all(br#"{"entry":{"at":"20"#).unwrap();
    assert_eq!(entries(data.path()), 1);
}
