// Starts `depthloom lsp` for experiment files, and restarts it when the setting changes.

import { homedir } from "node:os";
import * as vscode from "vscode";
import {
  DidOpenTextDocumentNotification,
  LanguageClient,
  type LanguageClientOptions,
  type ServerOptions,
} from "vscode-languageclient/node";
import { isExperiment, programOf } from "./recognition";

/** Comments before the first key are not longer. */
const FIRST_LINES = 200;

let client: LanguageClient | undefined;
/** The start or stop in progress; another one waits for it. */
let turn: Promise<void> = Promise.resolve();

export function activate(context: vscode.ExtensionContext): void {
  context.subscriptions.push(
    vscode.commands.registerCommand("depthloom.restart", () => inTurn(restart)),
    vscode.workspace.onDidOpenTextDocument(startFor),
    vscode.workspace.onDidChangeTextDocument((event) => startFor(event.document)),
    vscode.workspace.onDidChangeConfiguration((event) => {
      if (client !== undefined && event.affectsConfiguration("depthloom")) {
        void inTurn(restart);
      }
    }),
  );
  vscode.workspace.textDocuments.forEach(startFor);
}

export function deactivate(): Promise<void> {
  return inTurn(stop);
}

function inTurn(action: () => Promise<void>): Promise<void> {
  turn = turn.then(action, action);
  return turn;
}

function settings(): vscode.WorkspaceConfiguration {
  return vscode.workspace.getConfiguration("depthloom");
}

/** Whether the server takes care of a document. */
function isServed(document: vscode.TextDocument): boolean {
  if (document.languageId !== "yaml") {
    return false;
  }
  const patterns = settings().get<string[]>("files", []);
  const matches = patterns.some((pattern) => vscode.languages.match({ language: "yaml", pattern }, document) > 0);
  return matches || isExperiment(document.getText(new vscode.Range(0, 0, FIRST_LINES, 0)));
}

function startFor(document: vscode.TextDocument): void {
  if (client === undefined && isServed(document)) {
    void inTurn(async () => {
      if (client === undefined) {
        await start();
      }
    });
  }
}

async function restart(): Promise<void> {
  await stop();
  await start();
}

async function stop(): Promise<void> {
  const running = client;
  client = undefined;
  await running?.dispose();
}

async function start(): Promise<void> {
  const command = programOf(settings().get("path", "depthloom"), homedir());
  const server: ServerOptions = { command, args: ["lsp"] };
  const served = new Set<string>();
  const options: LanguageClientOptions = {
    documentSelector: [{ language: "yaml" }],
    synchronize: { fileEvents: vscode.workspace.createFileSystemWatcher("**/*.{yaml,yml}") },
    middleware: {
      // The server knows the documents that are experiments, and no others.
      didOpen: async (document, next) => {
        if (isServed(document)) {
          served.add(document.uri.toString());
          await next(document);
        }
      },
      didChange: async (event, next) => {
        const uri = event.document.uri.toString();
        if (served.has(uri)) {
          await next(event);
        } else if (isServed(event.document)) {
          // It has just become an experiment.
          served.add(uri);
          const opened = starting.code2ProtocolConverter.asOpenTextDocumentParams(event.document);
          await starting.sendNotification(DidOpenTextDocumentNotification.type, opened);
        }
      },
      didSave: async (document, next) => {
        if (served.has(document.uri.toString())) {
          await next(document);
        }
      },
      didClose: async (document, next) => {
        if (served.delete(document.uri.toString())) {
          await next(document);
        }
      },
      provideCompletionItem: (document, position, context, token, next) =>
        served.has(document.uri.toString()) ? next(document, position, context, token) : undefined,
      provideHover: (document, position, token, next) =>
        served.has(document.uri.toString()) ? next(document, position, token) : undefined,
      provideDefinition: (document, position, token, next) =>
        served.has(document.uri.toString()) ? next(document, position, token) : undefined,
      provideReferences: (document, position, options, token, next) =>
        served.has(document.uri.toString()) ? next(document, position, options, token) : undefined,
      provideDocumentHighlights: (document, position, token, next) =>
        served.has(document.uri.toString()) ? next(document, position, token) : undefined,
      provideDocumentSymbols: (document, token, next) =>
        served.has(document.uri.toString()) ? next(document, token) : undefined,
      prepareRename: (document, position, token, next) =>
        served.has(document.uri.toString()) ? next(document, position, token) : undefined,
      provideRenameEdits: (document, position, name, token, next) =>
        served.has(document.uri.toString()) ? next(document, position, name, token) : undefined,
    },
  };
  const starting = new LanguageClient("depthloom", "depthloom", server, options);
  client = starting;
  try {
    await starting.start();
  } catch (error) {
    client = undefined;
    const install = "Install depthloom, or set `depthloom.path` to the program.";
    const choice = await vscode.window.showErrorMessage(`Failed to start \`${command} lsp\`: ${error}. ${install}`, "Open settings");
    if (choice !== undefined) {
      await vscode.commands.executeCommand("workbench.action.openSettings", "depthloom.path");
    }
  }
}
