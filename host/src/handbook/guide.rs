//! The generated pages of the guide.

use super::topics::{Topic, effect, effects};
use crate::effects::catalogue;

/// Names of the files and their Markdown.
pub fn pages() -> Vec<(String, String)> {
    let file = |topic: Topic, text: String| (format!("{}.md", topic.name()), text);
    Topic::ALL
        .into_iter()
        .map(|topic| match topic {
            Topic::Effects => file(topic, of_effects()),
            _ => file(topic, topic.page().markdown()),
        })
        .collect()
}

/// The catalogue, then each effect with its picture.
fn of_effects() -> String {
    let mut text = effects().markdown();
    text += "\nEach picture is what the effect alone changes in a campaign of the virtual bench: the same campaign with it less without it. \
             Above the vibration error of the runs, \
             over frequency and over level (filled blue: sines; open orange: random vibration; of a band its middle), below the readings on \
             the dividing head.\n";
    for one in catalogue() {
        let own = effect(one).markdown();
        let own = own.replace("\n## ", "\n### ");
        let (title, rest) = own.split_once('\n').unwrap_or((&own, ""));
        text += &format!(
            "\n#{title}\n\n![What {id} changes](effects/{id}.svg)\n{rest}",
            id = one.id
        );
    }
    text
}
