//! Every message of the readers says all that it knows (place, value, bound), and what to do.

/// Beginnings of a way out, or of what a reader expected in place of what it found.
const WAYS_OUT: &str = "\
    ; give|; write|; split|; save|; copy|; cut|; repair|; correct|; export|; leave|; name|; numpy.|, give|\
    ; `record`|; `pymcap-cli|; it names|files are .bvh|export it again|must be those|(`record` writes them)|\
    export the skeleton";

#[test]
fn every_message_says_all_that_it_knows_and_what_to_do() {
    let source = concat!(include_str!("../src/error.rs"), include_str!("../src/mirror.rs"));
    let (mut wrong, mut count) = (Vec::new(), 0);
    for part in source.split("#[error(").skip(1).filter(|part| !part.starts_with("transparent")) {
        let (text, variant) = part.split_once(")]\n").expect("the end of the text");
        let text = text.replace('\\', " ").split_whitespace().collect::<Vec<_>>().join(" ");
        let lines = variant.lines().map(str::trim).filter(|line| !line.starts_with("//"));
        let variant = lines.take_while(|line| !line.starts_with("#[")).collect::<Vec<_>>().join(" ");
        let fields =
            variant.split_once('{').and_then(|(_, fields)| fields.split_once('}')).map_or("", |(fields, _)| fields);
        // A comma inside of a type has no colon behind it.
        for field in fields.split(',').filter_map(|field| field.split_once(':')).map(|(name, _)| name.trim()) {
            if !text.contains(&format!("{{{field}")) && !text.contains(&format!(".{field}")) {
                wrong.push(format!("{field} is not in {text}"));
            }
        }
        // Another message follows a wrapped one.
        if !fields.contains("source") && !WAYS_OUT.split('|').any(|out| text.contains(out)) {
            wrong.push(format!("no way out: {text}"));
        }
        count += 1;
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(count > 45, "{count} messages were read");
}
