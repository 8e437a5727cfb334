//! `vre help`

use clap::{CommandFactory, ValueEnum};

use super::{Arguments, COLUMNS, Command, Console, like};
use crate::error::Error;
use crate::handbook::Topic;

/// Explain a command, or a topic: campaign, columns, effects, verdicts, units
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  vre help columns\n  vre help diagnose")]
pub struct Help {
    /// A command or a topic; all of them are listed without one
    #[arg(value_name = "COMMAND|TOPIC")]
    topic: Option<String>,
}

impl Command for Help {
    fn run(self, console: &Console) -> Result<(), Error> {
        let mut vre = Arguments::command();
        vre.build();
        let Some(name) = self.topic else {
            let topics =
                Topic::ALL.map(|topic| format!("  {:<12}{}\n", topic.name(), summary(topic)));
            let topics = topics.concat();
            let commands = vre.render_long_help();
            return console.print(format!("{commands}\nTopics of `vre help`:\n{topics}"));
        };
        if let Ok(topic) = Topic::from_str(&name, true) {
            return console.print(topic.page().text(COLUMNS));
        }
        if let Some(command) = vre.find_subcommand_mut(&name) {
            return console.print(command.render_long_help());
        }
        let commands = vre.get_subcommands().map(clap::Command::get_name);
        let known: Vec<&str> = commands.chain(Topic::ALL.map(Topic::name)).collect();
        Err(Error::Usage(format!(
            "help: no command and no topic \"{}\"{}; see `vre help`",
            crate::error::clip(&name),
            like(&name, known)
        )))
    }
}

/// What the topic's own documentation says of it.
fn summary(topic: Topic) -> String {
    let value = topic.to_possible_value();
    let help = value.and_then(|value| value.get_help().map(ToString::to_string));
    help.unwrap_or_default()
}
