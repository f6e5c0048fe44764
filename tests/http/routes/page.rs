use crate::support::app::TestApp;

/// With the viewer where the build had npm, else with links to the documentation and how to get the viewer.
#[tokio::test]
async fn the_start_page_is_the_viewer_or_says_how_to_get_it() {
    let app = TestApp::new().await;
    let page = app.get("/").await;
    assert!(page.header("content-type").starts_with("text/html"));
    let text = String::from_utf8(page.body.to_vec()).unwrap();
    if text.contains("id=\"app\"") {
        let policy = page.header("content-security-policy");
        assert!(policy.contains("script-src 'self';") && !policy.contains("unsafe"), "{policy}");
    } else {
        assert!(text.contains("/docs/") && text.contains("Node.js"), "{text}");
    }
}

#[tokio::test]
async fn a_problem_names_a_page_that_explains_it() {
    let app = TestApp::new().await;
    let problem = app.get("/v1/jobs/nothing").await.problem(404, "not-found");
    let page = app.get(problem["type"].as_str().unwrap()).await;
    assert!(page.header("content-type").starts_with("text/html"));
    let text = String::from_utf8(page.body.to_vec()).unwrap();
    assert!(text.contains("<h2>not-found</h2>") && text.contains("<li>Client:"), "{text}");
    app.get("/problems/%3Cscript%3E").await.problem(404, "not-found");
}

#[tokio::test]
async fn every_link_of_the_start_page_is_answered() {
    let app = TestApp::new().await;
    let page = String::from_utf8(app.get("/").await.body.to_vec()).unwrap();
    let links = ["href=\"", "src=\""].iter().flat_map(|kind| page.split(kind).skip(1));
    let links: Vec<&str> = links.map(|rest| rest.split('"').next().unwrap()).collect();
    assert!(links.len() >= 3, "{links:?}");
    for link in links {
        let answer = app.get(link.trim_start_matches('.')).await;
        assert!(answer.status.is_success(), "{link}");
        let kind = answer.header("content-type");
        let expected = match link.rsplit('.').next() {
            Some("js") => "text/javascript",
            Some("css") => "text/css",
            Some("svg") => "image/svg+xml",
            _ => "",
        };
        assert!(kind.starts_with(expected), "{link}: {kind}");
    }
    app.get("/assets/none.js").await.problem(404, "not-found");
}
